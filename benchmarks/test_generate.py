"""Datasets: what a capture costs against what was told before, and what a second Dask worker is worth.

    make bench TESTS=benchmarks/test_generate.py

Takes some five minutes on two cores. Figures are of one core a job; the floor of the rig's optics is in test_rig.py.
"""

import time
from itertools import count

import pytest

from millisight.datasets.cost import slowness
from millisight.datasets.engine import Engine, engine_of
from millisight.datasets.generate import carried_out, planned
from millisight.datasets.recipefile import recipe_from_table
from small_cluster import Cluster

ONE = Engine("threads", 1, 1)
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
    plan = planned(recipe(**settings), tmp_path / "out")
    told = plan.costs[-1].seconds
    for job in plan.todo[:-1]:
        assert job.key != plan.todo[-1].key
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
    print(f"\n{title}: {took:.1f} core-seconds, told {told:.1f} (x {slowness():.2f} here)")


@pytest.mark.benchmark(group="two workers")
def test_two_workers_do_almost_twice_as_much_as_one(benchmark, tmp_path):
    """Eight captures by one Dask worker, then by two; the workers have compiled and imported everything before."""
    pytest.importorskip("distributed")
    cluster = Cluster(tmp_path)
    numbers = count()
    names = ["golf_ball", "strawberry", "plum", "lemon"]

    def seconds(workers, chosen):
        engine = engine_of(cluster.of(workers))
        out = tmp_path / f"out{next(numbers)}"
        plan = planned(recipe(chosen, ["los", "carton"]), out)
        began = time.perf_counter()
        done = carried_out(plan, engine)
        assert (done.failures, done.made) == ((), 2 * len(chosen))
        return time.perf_counter() - began

    try:
        seconds(1, names[:1])
        one = seconds(1, names)
        cluster.of(2)
        seconds(2, names[:2])
        two = benchmark.pedantic(seconds, (2, names), rounds=1)
    finally:
        cluster.end()
    benchmark.extra_info.update(one=one, two=two, ratio=one / two)
    print(f"\none worker {one:.1f} s, two {two:.1f} s: {one / two:.2f} times the throughput")
