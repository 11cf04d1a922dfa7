"""Datasets: what a capture costs against what was told before, and what a second Dask worker is worth.

    make bench TESTS=benchmarks/test_generate.py

Takes some five minutes on two cores. Figures are of one core a job; the floor of the rig's optics is in test_rig.py.
"""

import time
from itertools import count

import pytest

from helpers.small_cluster import Cluster
from millisight.datasets.generation import Engine, engine_of, plan_dataset, recipe_from_table, run_plan, slowness

ONE = Engine("threads", 1, 1)
ROUNDS = 2
FAST = [{"preset": "iwr1443", "frame_period": 0.125}]
SLOW = [{"preset": "position2go", "mount": [0, 0, 0]}]


def recipe(names, conditions=("los",), radars=FAST, spacing=0.0039, keep="images", **changes):
    """Captures over apertures that reach 4 cm beyond the object, as in bench24.toml."""
    world = {
        "scan": {"size": [0.4, 0.4], "corner": [0.0, 0.08], "row_spacing": spacing},
        "arm": {"speed": 0.02 if radars is FAST else 0.06},
        "radars": radars,
    }
    image = {"spacing": [0.0025, 0.0025, 0.01], "margin": 0.03}
    rig = {"conditions": list(conditions), "keep": keep, "margin": 0.04, "empty": [], "image": image, "world": world}
    return recipe_from_table({"name": "bench", "objects": {"names": list(names)}, "rig": rig, **changes})


@pytest.mark.parametrize(
    ("title", "settings"),
    [
        ("warm up", {"names": ["golf_ball"], "spacing": 0.02}),
        ("golf ball, a quarter of the rows", {"names": ["golf_ball"], "spacing": 0.0156}),
        ("golf ball", {"names": ["golf_ball"]}),
        ("golf ball, carton", {"names": ["golf_ball"], "conditions": ["los", "carton"]}),
        ("golf ball, carton + cloth", {"names": ["golf_ball"], "conditions": ["los", "carton+cloth"]}),
        ("sugar box", {"names": ["sugar_box"]}),
        ("sugar box, carton", {"names": ["sugar_box"], "conditions": ["los", "carton"]}),
        ("mug", {"names": ["mug"]}),
        ("power drill", {"names": ["power_drill"]}),
        ("mug, 24 GHz", {"names": ["mug"], "radars": SLOW, "spacing": 0.006}),
        ("mug, 24 GHz, carton", {"names": ["mug"], "radars": SLOW, "spacing": 0.006, "conditions": ["los", "carton"]}),
    ],
)
@pytest.mark.benchmark(group="a capture")
def test_seconds_a_capture(benchmark, tmp_path, title, settings):
    """The last of the recipe's jobs, by one thread, and what was told of it."""
    plan = plan_dataset(recipe(**settings), tmp_path / "out")
    told = plan.costs[-1].seconds
    started = []

    def make():
        started.append(time.process_time())
        plan.todo[-1].make(tmp_path, tmp_path / "stage", {"simulated": True})
        started.append(time.process_time())

    for thing in plan.things.values():
        thing.write(tmp_path)
    engine_run = list(ONE.run(lambda _: make(), [0]))
    assert not engine_run[0].failure
    benchmark.pedantic(lambda: None)
    took = started[1] - started[0]
    benchmark.extra_info.update(core_seconds=took, told=told)
    print(f"\n{title}: {took:.1f} core-seconds, told {told:.1f} (x {slowness().median:.2f} here)")


@pytest.mark.benchmark(group="two workers")
def test_two_workers_do_almost_twice_as_much_as_one(benchmark, tmp_path):
    """Eight captures by a cluster of one worker and by one of two, in turn; all have compiled and imported before.

    Where others want the cores too, seconds of the processor tell: what a capture takes of it must not grow with the
    number of workers, and then free cores do twice as much.
    """
    pytest.importorskip("distributed")
    numbers = count()
    names = ["golf_ball", "strawberry", "plum", "lemon"]
    clusters = {}

    def spent(workers, chosen=names):
        """Seconds by the clock, and of the processor."""
        cluster, out = clusters[workers], tmp_path / f"out{next(numbers)}"
        engine, plan = engine_of(cluster.address), plan_dataset(recipe(chosen, ["los", "carton"]), out)
        began, busy = time.perf_counter(), cluster.processor_seconds()
        done = run_plan(plan, engine)
        assert (done.failures, done.made) == ((), 2 * len(chosen))
        return time.perf_counter() - began, cluster.processor_seconds() - busy

    try:
        for workers in (1, 2):
            folder = tmp_path / f"cluster{workers}"
            folder.mkdir()
            clusters[workers] = Cluster(folder)
            clusters[workers].of(workers)
            spent(workers, names[: 2 * workers])
        rounds = [(spent(1), spent(2)) for _ in range(ROUNDS)]
        benchmark.pedantic(lambda: None)
    finally:
        for cluster in clusters.values():
            cluster.end()
    for (one, busy_one), (two, busy_two) in rounds:
        print(
            f"\none worker {one:.1f} s ({busy_one:.1f} s of a core), two {two:.1f} s ({busy_two:.1f} s): "
            f"{one / two:.2f} times the throughput, {busy_two / busy_one:.2f} times the processor's time"
        )
    benchmark.extra_info.update(ratios=[one[0] / two[0] for one, two in rounds])
