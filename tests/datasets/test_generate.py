"""Datasets from recipes: the same bytes by whatever engine, however often killed; found, verified and converted."""

import hashlib
import json
import os
import pickle
import signal
import subprocess
import sys
import time
from functools import partial
from itertools import islice

import numpy as np
import pytest

import millisight as ms
from helpers import small_recipe
from helpers.processes import wait_for
from helpers.small_cluster import Cluster
from helpers.small_jobs import failing, napping
from millisight.core import sealed
from millisight.core.errors import DamagedFileError, DeviceError, FileError, FormatError, InputError, UnknownNameError
from millisight.datasets import convert, prepare_objects, read_manifest, verify
from millisight.datasets.generation import Engine, RigJob, engine_of, plan_dataset, run_plan
from millisight.datasets.generation import _cost as cost
from millisight.datasets.generation import _generate as generate
from millisight.datasets.generation._jobs import jobs_of
from millisight.datasets.generation._ledger import JOURNAL_NAME, Ledger
from millisight.datasets.generation._simulator_job import SimulatorJob
from millisight.imaging import form_image
from millisight.io import load_extras, open_capture
from millisight.io.mito import read_published
from millisight.rig.virtual import VirtualRig, World

HERE = Engine("threads", 1, 1)
JOBS = 4
NAPPED = [(number, number**2, "") for number in range(12)]
BALL = "058_golf_ball/robot_collected/0_0_0/exp1"


def make(out, engine=HERE, progress=None, **changes):
    return run_plan(plan_dataset(small_recipe.recipe(**changes), out), engine, progress=progress)


@pytest.fixture(scope="module")
def made(small_dataset):
    """The small recipe's dataset, made in one process by one thread; what was said of it; the calls of progress."""
    out, done, calls = small_dataset
    assert (done.made, done.kept, done.failures, done.others) == (JOBS, 0, (), ())
    return out, done, calls


def contents(folder):
    """The bytes of every file that is not hidden."""
    paths = [p for p in sorted(folder.rglob("*")) if p.is_file() and not p.name.startswith(".")]
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in paths}


@pytest.mark.slow
def test_it_is_a_dataset_of_the_published_layout(made, tmp_path):
    out, _, _ = made
    found = ms.datasets.open(out)
    assert [one.folder.name for one in found.objects] == ["058_golf_ball", "tripod_EMPTY", "tripod_background"]
    assert {p.name for p in out.iterdir() if not p.name.startswith(".")} == {
        "058_golf_ball", "tripod_EMPTY", "tripod_background", "README.md", "manifest.jsonl", "splits.json", "truth",
    }  # fmt: skip
    assert found.stray == ()
    kinds = {(part.sight if hasattr(part, "sight") else "", i.kind, i.radar, i.ext)
             for part in found.objects[0].parts for i in part.items}  # fmt: skip
    assert kinds == {
        *((sight, *rest) for sight in ("los", "nlos") for rest in (
            ("info", "", ""), ("image", "24_ghz", ""), ("radar mask", "24_ghz", ""), ("raw", "24_ghz", ""),
            ("camera frame", "", ""))),
        ("los", "camera mask", "", ""),
        *(("", kind, "24_ghz", ext) for kind in ("image", "radar mask") for ext in ("_specular", "_edges")),
    }  # fmt: skip
    checked = verify(out, workers=1)
    assert len(checked) > 15
    assert [one.problems for one in checked if not one.ok] == []
    done = convert(found.only(["058"]), tmp_path / "converted", workers=1)
    assert (done.made, done.failures) == (12, ())


def test_the_manifest_names_every_file_with_its_checksum_and_job(made):
    out, done, _ = made
    manifest = read_manifest(out)
    assert manifest.entries == done.manifest.entries
    assert manifest.settings == {"generator": 1, "recipe": "small", "seed": 3}
    files = contents(out)
    beside = {"README.md", "manifest.jsonl", "splits.json"}
    assert set(files) - beside == set(manifest.entries)
    assert beside < set(files)
    for path, entry in manifest.entries.items():
        assert entry.sha256 == files[path]
        if entry.kind != "mesh":
            (source,) = entry.sources
            assert source.sha256 == files[source.path]
            assert json.loads((out / source.path).read_text())["made_by"]["simulated"] is True
    assert not (out / JOURNAL_NAME).exists()
    assert not (out / ".millisight.partial").exists()


def test_every_file_that_has_room_says_that_it_is_simulated_and_how(made):
    out, _, _ = made
    said = {}
    for path in out.rglob("*.pkl"):
        if "unprocessed/radars" not in path.as_posix():  # the published list of rows, as the recorder writes it
            said[path] = read_published(path).extras
    for path in out.rglob("*.h5"):
        record = ms.load(path)
        said[path] = {**getattr(record, "metadata", {}), **load_extras(path)}
    assert len(said) == 20
    for path, extras in said.items():
        assert extras["simulated"], path
        expected = "simulator of the paper" if "simulation" in path.parts else "virtual rig: physical optics"
        assert str(np.asarray(extras["physics"]).item()).startswith(expected), path
    infos = list(out.rglob("experiment_info.json"))
    assert len(infos) == 3
    assert all(json.loads(path.read_text())["simulated"] for path in infos)
    card = (out / "README.md").read_text()
    assert "Everything here is simulated. Nothing was measured." in card
    assert "| captures | 24_ghz | carton, tripod | 1 |" in card
    assert "| simulated images | 24_ghz | specular, edge | 2 |" in card


def test_the_images_are_those_of_the_captures_less_the_empty_scene(made):
    out, _, _ = made
    image = read_published(out / BALL / "los/processed/radars/24_ghz/processed_image.pkl").record
    with open_capture(out / BALL / "los/unprocessed/radars/24_ghz/capture.h5") as capture:
        frames = capture.frames_of(slice(None))
        empty = out / "tripod_background/robot_collected/0_0_0/exp1/los/unprocessed/radars/24_ghz/recorded.capture.h5"
        less = ms.Capture(radar=capture.radar, trajectory=capture.trajectory,
                          frames=frames - ms.load(empty).frames[:1])  # fmt: skip
        assert np.array_equal(form_image(less, image.grid).values, image.values)
        assert not np.allclose(form_image(capture, image.grid).values, image.values)
        assert capture.metadata["experiment"]["conditions"] == {"los": "los", "nlos": "carton"}


def test_the_truth_is_the_world_that_was_scanned(made):
    out, _, _ = made
    world = World.from_toml(out / "truth" / BALL / "nlos/24_ghz/world.toml")
    assert world.objects[0].object == "golf_ball"
    assert world.carton is not None
    mask = read_published(out / BALL / "los/processed/radars/24_ghz/radar_masks.pkl").record
    x, y = np.meshgrid(mask.grid_xy.x, mask.grid_xy.y, indexing="ij")
    away = np.hypot(x - 0.17, y - 0.28)
    assert mask.inside[away < 0.0205].all()
    assert not mask.inside[away > 0.0225].any()
    seen = np.load(out / "truth" / BALL / "nlos/24_ghz/camera.masks.npz")
    camera = read_published(out / BALL / "los/processed/camera/camera_masks.pkl").record
    assert not seen["0_golf_ball.visible"].any()
    # The same ball from nearly the same place: what the carton hides is what the line of sight shows.
    both = camera.pixels & seen["0_golf_ball.amodal"]
    assert both.sum() > 0.9 * camera.pixels.sum() > 500


def test_it_tells_of_its_progress(made):
    _, _, calls = made
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    assert len(calls) == JOBS
    assert calls[-1][0] == calls[-1][1]


@pytest.mark.slow
def test_the_number_of_threads_changes_no_byte(tmp_path):
    rig = small_recipe.table()["rig"]
    scans = [{"radars": [{"preset": "iwr1443", "frame_period": 0.125}]}]
    changes = {"simulator": None, "rig": {**rig, "conditions": ["los"], "scans": scans}}
    made = []
    for threads in (1, 2):
        done = make(tmp_path / str(threads), Engine("threads", 1, threads), **changes)
        assert (done.made, done.failures) == (1, ())
        made.append(contents(tmp_path / str(threads)))
    assert made[0] == made[1]
    assert any("77_ghz/capture.h5" in path for path in made[0])


COMMAND = "import sys, typer; from millisight.cli.generate import generate; typer.run(generate)"


@pytest.mark.parametrize(
    "change",
    [
        {"path": ["a"]}, {"path": 3}, {"size": "1"}, {"sha256": None}, {"sources": 3}, {"path": "../out"},
        {"sources": [{"path": [], "size": 1, "sha256": ""}]},
    ],
)  # fmt: skip
def test_a_damaged_line_of_the_journal_tells_nothing(tmp_path, change):
    source = {"path": "a/job.json", "size": 1, "sha256": "0", "files": 1}
    good = {"path": "a/b.h5", "kind": "image", "size": 1, "sha256": "0", "sources": [source], "notes": []}
    lines = [sealed(json.dumps(line)) for line in ([good], [good | change], {"path": 1}, 3, [3], [[good]])]
    other = sealed(json.dumps([good | {"path": "a/c.h5"}])).replace("c.h5", "d.h5")  # of another text than its checksum
    damaged = "[" + "[" * 100_000 + "\n\xff"
    (tmp_path / JOURNAL_NAME).write_text("\n".join([*lines, other, json.dumps([good]), damaged]))
    told = Ledger(tmp_path, {}).files(["a/job.json"])
    assert [entry.path for entry in told] == ["a/b.h5"]


@pytest.mark.slow
def test_killed_with_no_chance_to_clean_up_it_goes_on_in_two_processes_with_the_same_bytes(made, tmp_path):
    """The bytes are those of one process that was not killed."""
    out, _, _ = made
    again, recipe = tmp_path / "again", tmp_path / "recipe.toml"
    recipe.write_text(small_recipe.TEXT)
    command = [sys.executable, "-c", COMMAND, recipe, "-o", again, "--workers", "2"]
    run = subprocess.Popen(command, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    wait_for(lambda: (again / JOURNAL_NAME).exists())
    os.killpg(run.pid, signal.SIGKILL)
    run.communicate()
    told = (again / JOURNAL_NAME).read_text()
    assert 1 <= told.count("\n") < JOBS
    # A line that was cut off tells nothing.
    (again / JOURNAL_NAME).write_text(told + told[: len(told) // 2])
    (again / ".millisight.partial" / "left").mkdir(exist_ok=True)
    done = make(again, engine_of("processes", 2))
    assert done.failures == ()
    assert done.kept == told.count("\n")
    assert done.made + done.kept == JOBS
    assert contents(again) == contents(out)


def test_on_a_cluster_an_error_is_the_jobs_own(cluster):
    # First: of the tests of a cluster it is the one that loses no worker.
    outcomes = sorted(engine_of(cluster.of(2)).run(failing, range(4)))
    assert [outcome.result for outcome in outcomes] == [0, 1, None, 3]
    assert outcomes[2].failure == "no such thing"


@pytest.mark.slow
def test_a_cluster_makes_the_same_bytes_though_a_worker_is_killed(tmp_path, cluster):
    """Simulated images, which are quick; the rig's jobs go to a cluster in test_relay.py."""
    again, engine = tmp_path / "again", engine_of(cluster.of(2))
    changes = simulated(["golf_ball", "b_marbles", "strawberry", "b_lego_duplo", "d_lego_duplo", "f_lego_duplo"])

    def kill_one(*_):
        # The first job is done, others are shared out or begun: those of one worker are lost.
        if len(cluster.workers) == 2:
            cluster.kill_one()

    done = make(again, engine, kill_one, **changes)
    assert len(cluster.workers) == 1
    assert (done.made, done.failures) == (6, ())
    make(tmp_path / "here", **changes)
    assert contents(again) == contents(tmp_path / "here")


@pytest.mark.slow
def test_a_lost_worker_costs_only_what_it_was_at(tmp_path, cluster):
    outcomes = engine_of(cluster.of(2)).run(partial(napping, tmp_path), range(12))
    found = list(islice(outcomes, 3))
    known, lost = {outcome.number for outcome in found}, cluster.workers[-1].pid
    wait_for(lambda: any(int(path.stem) not in known for path in tmp_path.glob(f"*.{lost}")))
    cluster.kill_one()
    found.extend(outcomes)
    assert sorted((outcome.number, outcome.result, outcome.failure) for outcome in found) == NAPPED
    # Begun anew is what the lost worker was at or had done without our having its result, and nothing else.
    begun = begun_by(tmp_path)
    anew = {number for number, workers in begun.items() if len(workers) > 1}
    assert anew
    assert anew.isdisjoint(known)
    assert all(lost in begun[number] for number in anew)


@pytest.mark.slow
def test_what_a_lost_worker_had_done_and_not_handed_over_is_done_again(tmp_path, cluster):
    outcomes = engine_of(cluster.of(2)).run(partial(napping, tmp_path), range(12))
    found = [next(outcomes)]
    wait_for(lambda: len(begun_by(tmp_path)) == 12)
    time.sleep(0.5)
    cluster.kill_one()
    # The other worker is at what was lost: the client knows that it has no longer what was done.
    wait_for(lambda: any(len(workers) > 1 for workers in begun_by(tmp_path).values()))
    found.extend(outcomes)
    assert sorted((outcome.number, outcome.result, outcome.failure) for outcome in found) == NAPPED


def begun_by(folder):
    """By number, the processes that began a job."""
    begun = {}
    for path in folder.iterdir():
        number, worker = path.name.split(".")
        begun.setdefault(int(number), set()).add(int(worker))
    return begun


def test_engines_are_checked():
    assert engine_of("processes", 3).workers == 3
    assert engine_of("threads", 3) == Engine("threads", 1, 3)
    with pytest.raises(UnknownNameError, match="scheduler 'slurm'"):
        engine_of("slurm")
    with pytest.raises(InputError, match="workers"):
        engine_of("tcp://127.0.0.1:1", 3)


def test_where_no_scheduler_answers_it_says_so(monkeypatch):
    monkeypatch.setattr("millisight.datasets.generation._engine._CONNECT", 0.5)
    with pytest.raises(DeviceError, match="no Dask scheduler answers at tcp://127.0.0.1:1"):
        engine_of("tcp://127.0.0.1:1")


def simulated(names, **changes):
    """Jobs of the simulator alone, which are quick."""
    return {"rig": None, "objects": {"names": names}, **changes}


@pytest.mark.slow
def test_a_job_that_fails_stops_no_other_and_is_done_the_next_time(tmp_path, monkeypatch):
    make_one = SimulatorJob.make

    def fails(job, *arguments):
        if "golf" in job.key:
            raise InputError("the ball rolled away")
        return make_one(job, *arguments)

    monkeypatch.setattr(SimulatorJob, "make", fails)
    names = ["golf_ball", "b_marbles", "strawberry"]
    done = make(tmp_path / "out", **simulated(names))
    assert (done.made, done.failures) == (2, (("058_golf_ball/simulation/0_0_0/24_ghz", "the ball rolled away"),))
    assert not (tmp_path / "out" / "058_golf_ball" / "simulation").exists()
    splits = json.loads((tmp_path / "out" / "splits.json").read_text())["by_object"]
    assert sum(map(len, splits.values())) == 2
    monkeypatch.undo()
    done = make(tmp_path / "out", **simulated(names))
    assert (done.made, done.kept, done.failures) == (1, 2, ())
    make(tmp_path / "other", **simulated(names))
    assert contents(tmp_path / "out") == contents(tmp_path / "other")


@pytest.mark.slow
def test_what_is_changed_is_made_anew_and_the_rest_is_kept(tmp_path):
    names = ["golf_ball", "strawberry"]
    out = tmp_path / "out"
    assert make(out, **simulated(names)).made == 2
    before = contents(out)
    # Nothing to do.
    assert (make(out, **simulated(names)).made, contents(out)) == (0, before)
    # A file is lost, another one cut short.
    lost = out / "058_golf_ball/simulation/0_0_0/processed/radars/24_ghz/processed_image_edges.pkl"
    lost.unlink()
    done = make(out, **simulated(names))
    assert (done.made, done.kept, contents(out)) == (1, 1, before)
    # An object more, and one less: what was of it is named, not removed.
    done = make(out, **simulated(["strawberry", "b_marbles"]))
    assert (done.made, done.kept) == (1, 1)
    assert done.others == ("truth/058_golf_ball/simulation/0_0_0/24_ghz/job.json",)
    assert lost.exists()
    assert not any("golf" in path for path in done.manifest.entries)
    # Other settings: everything.
    changed = {**small_recipe.table()["simulator"], "tau_deg": 6.0}
    assert make(out, **simulated(names, simulator=changed)).made == 2


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(InputError, match="is not empty, and not a dataset of this recipe"):
        plan_dataset(small_recipe.recipe(), tmp_path)
    make(tmp_path / "out", **simulated(["golf_ball"]))
    with pytest.raises(InputError, match="holds another dataset"):
        plan_dataset(small_recipe.recipe(seed=4), tmp_path / "out")


def test_two_runs_in_one_folder_are_refused(tmp_path):
    with Ledger(tmp_path, {}).writing(), pytest.raises(FileError, match=r"another run \(process \d+\) is using"):
        make_room(tmp_path)


def make_room(folder):
    with Ledger(folder, {}).writing():
        pass


def test_a_short_disk_is_told_before_the_work(tmp_path, monkeypatch):
    usage = type("Usage", (), {"free": 1000})
    monkeypatch.setattr(generate.shutil, "disk_usage", lambda _: usage)
    plan = plan_dataset(small_recipe.recipe(), tmp_path / "out")
    with pytest.raises(FileError, match=r"has 0 MB left; the dataset needs"):
        run_plan(plan, HERE)
    assert not (tmp_path / "out").exists()


def test_the_cost_is_told_before_and_grows_with_the_work():
    def costs(**changes):
        plan = plan_dataset(small_recipe.recipe(**changes), "nowhere")
        return {job.key: cost for job, cost in zip(plan.todo, plan.costs, strict=True)}, plan

    few, plan = costs()
    assert len(few) == JOBS
    slow = plan.slowness
    assert 0.1 < slow.low <= slow.median <= slow.high < 100
    total = plan.total(2)
    assert total.core_seconds == pytest.approx(slow.median * sum(cost.seconds for cost in few.values()))
    assert total.low < slow.low / slow.median
    assert total.high > slow.high / slow.median
    assert total.core_seconds / 2 <= total.wall <= total.core_seconds
    rig = small_recipe.table()["rig"]
    denser = {**rig, "world": {**rig["world"], "scan": {**rig["world"]["scan"], "row_spacing": 0.01}}}
    more, _ = costs(rig=denser)
    key = next(key for key in few if "nlos" in key)
    assert more[key].seconds > few[key].seconds
    kept, _ = costs(rig={**rig, "keep": "images"})
    assert kept[key].kept < few[key].kept


def test_waiting_for_the_core_and_one_disturbed_probe_do_not_change_the_estimate(monkeypatch):
    started = time.perf_counter()
    assert cost.processor_seconds(lambda: time.sleep(0.2)) < 0.1
    assert time.perf_counter() - started >= 0.2
    probes = iter([2.0, 2.1, 1.9, 2.0, 50.0, 2.0, 2.0])
    monkeypatch.setattr(cost, "processor_seconds", lambda work: next(probes))
    found = cost.slowness.__wrapped__()  # it is measured once a process
    assert next(probes, None) is None
    assert (found.high / found.median, found.low / found.median) == pytest.approx((25, 0.95))


def test_where_there_is_much_to_do_scans_of_the_recipe_tell_how_long(monkeypatch):
    """Each stands for as much of the work, whatever the figures say of it."""
    factors = iter([2.0, 3.0, 2.5, 2.5, 2.5])
    figures = []

    def slowness_of(scans, done):
        return cost.slowness_of(((stage, figures.append(told) or told) for stage, told in scans), done)

    monkeypatch.setattr(generate, "slowness_of", slowness_of)
    monkeypatch.setattr(cost, "_echo_seconds", lambda rig: 1e9)  # nothing else takes time
    monkeypatch.setattr(
        VirtualRig, "estimated_seconds", lambda self, clock: next(factors) * figures[-1] / cost._ALL_ROWS
    )
    monkeypatch.setattr(generate, "_MUCH", 1.0)
    told = []
    plan = plan_dataset(small_recipe.recipe(), "nowhere", progress=lambda *pair: told.append(pair))
    assert next(factors, None) is None
    assert plan.slowness.median == pytest.approx(2.5)
    error = np.std([2, 3, 2.5, 2.5, 2.5], ddof=1) / np.sqrt(5)
    assert (plan.slowness.low, plan.slowness.high) == pytest.approx((2.5 - 2 * error, 2.5 + 2 * error))
    total = plan.total(1)
    assert (total.low, total.high) == pytest.approx((0.85 * (1 - 0.8 * error), 1.2 * (1 + 0.8 * error)))
    assert told[-1] == (2 * len(plan.todo), 2 * len(plan.todo))


def test_the_more_there_is_to_do_the_more_scans_are_tried(monkeypatch):
    tried, told = [], []
    monkeypatch.setattr(VirtualRig, "estimated_seconds", lambda self, clock: tried.append(self) or 1.0)
    monkeypatch.setattr(generate, "_MUCH", 1.0)
    work = sum(one.seconds for one in plan_dataset(small_recipe.recipe(simulator=None), "nowhere").costs)
    tried.clear()
    for each, expected in ((1e9, 5), (work / 8.5, 8), (1e-9, 24)):
        monkeypatch.setattr(generate, "_EACH", each)
        plan = plan_dataset(small_recipe.recipe(), "nowhere", progress=lambda *pair: told.append(pair))
        assert len(tried) == expected
        assert told == sorted(told)
        assert told[-1] == (2 * len(plan.todo), 2 * len(plan.todo))
        tried.clear()
        told.clear()


def test_what_finished_jobs_took_corrects_what_is_left():
    told = {"a": ("rig", 10.0), "b": ("rig", 20.0), "c": ("simulator", 10.0), "d": ("simulator", 10.0)}
    remaining = cost.Remaining(told, slowness=2.0)
    assert remaining.finish("a", 40.0) == (40, 40 + 4 * (20 + 10 + 10))  # four times as long, as far as is known
    assert remaining.finish("c", 5.0) == (45, 45 + 80 + 5)  # each kind by its own
    assert remaining.finish("b", None) == (125, 125 + 5)  # it failed: as long as it would have taken
    assert remaining.finish("d", 7.2) == (133, 133)
    assert cost.Remaining(told, slowness=2.0).finish("a", None) == (20, 20 + 80)


def test_raw_text_is_read_whole_however_short_its_rows_are():
    rig = small_recipe.table()["rig"]
    long, short = (
        plan_dataset(small_recipe.recipe(rig={**rig, "keep": keep}), "nowhere") for keep in ("raw", "images")
    )
    assert sum(cost.seconds for cost in long.costs) > 1.2 * sum(cost.seconds for cost in short.costs)


def test_the_estimated_bytes_are_about_right(made):
    out, done, _ = made
    plan = plan_dataset(small_recipe.recipe(), out.with_name("nowhere"))
    expected = sum(cost.kept for cost in plan.costs)
    assert 0.8 * expected < sum(entry.size for entry in done.manifest.entries.values()) < 1.25 * expected


@pytest.mark.slow
def test_raw_files_alone_can_be_kept_and_scans_may_hold_both_radars(tmp_path):
    rig = small_recipe.table()["rig"]
    radars = [{"preset": "position2go", "mount": [0, 0, 0]}, {"preset": "iwr1443", "frame_period": 0.125}]
    rig = {**rig, "keep": "raw", "conditions": ["los"], "world": {**rig["world"], "radars": radars}}
    rig["world"]["scan"] = {"size": [0.16, 0.1], "corner": [0.09, 0.23], "row_spacing": 0.08}
    scene = {"objects": [{"object": "b_marbles", "offset": [-0.03, 0]}, {"object": "golf_ball", "offset": [0.03, 0]}]}
    done = make(tmp_path / "out", objects={}, scenes=[scene], rig=rig, simulator=None)
    assert (done.made, done.failures) == (2, ())
    experiment = tmp_path / "out" / "063-b_marbles+058_golf_ball/robot_collected/0_0_0/exp1/los"
    for radar in ("24_ghz", "77_ghz"):
        assert list((experiment / "unprocessed/radars" / radar / "radar_data").iterdir())
        assert not list((experiment / "unprocessed/radars" / radar).glob("*.h5"))
        masks = {
            ext: read_published(experiment / "processed/radars" / radar / f"radar_masks{ext}.pkl").record.inside
            for ext in ("", "_0_b_marbles", "_1_golf_ball")
        }
        assert masks["_0_b_marbles"].any()
        assert masks["_1_golf_ball"].any()
        assert not (masks["_0_b_marbles"] & masks["_1_golf_ball"]).any()
        assert np.array_equal(masks["_0_b_marbles"] | masks["_1_golf_ball"], masks[""])
    seen = np.load(tmp_path / "out/truth" / experiment.relative_to(tmp_path / "out") / "24_ghz+77_ghz/camera.masks.npz")
    assert {"0_b_marbles.visible", "1_golf_ball.visible"} <= set(seen)


def test_jobs_can_travel(tmp_path):
    plan = plan_dataset(small_recipe.recipe(), tmp_path / "out")
    again = pickle.loads(pickle.dumps(plan.jobs))  # noqa: S301
    assert [job.description() for job in again] == [job.description() for job in plan.jobs]
    assert {type(job) for job in again} == {RigJob, SimulatorJob}


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    pytest.importorskip("distributed", reason='needs Dask: pip install "millisight[cluster]"')
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.end()


@pytest.mark.slow
def test_files_of_the_users_beside_ours_stay(tmp_path):
    """They were removed or overwritten when a job was done again."""
    out = tmp_path / "out"
    make(out, **simulated(["golf_ball"]))
    image = next(out.rglob("processed_image_edges.pkl"))
    mine = image.with_name("my.mask.h5")
    mine.write_bytes(b"drawn by hand")
    card = out / "README.md"
    card.write_text(f"---\nlicense: mit\n---\n{card.read_text()}\nMeasured by me.\n")
    image.write_bytes(b"damaged")
    done = make(out, **simulated(["golf_ball"]))
    assert (done.made, done.failures) == (1, ())
    assert mine.read_bytes() == b"drawn by hand"
    assert card.read_text().startswith("---\nlicense: mit\n---\n<!-- millisight generate:")
    assert card.read_text().endswith("to here -->\n\nMeasured by me.\n")
    card.write_bytes(b"# My own\r\n\xff")
    splits = out / "splits.json"
    splits.write_text(splits.read_text().replace('"train"', '"mine"'))
    changed = splits.read_text()
    make(out, **simulated(["golf_ball"]))
    assert card.read_bytes() == b"# My own\r\n\xff"
    assert splits.read_text() == changed
    splits.write_text(changed[:50])
    make(out, **simulated(["golf_ball"]))
    assert json.loads(splits.read_text())["seed"] == 3


def test_a_mesh_of_the_users_in_the_place_of_an_objects_stays(tmp_path):
    out = tmp_path / "out"
    make(out, **simulated(["golf_ball"]))
    mine = out / "012_strawberry" / "nontextured.stl"
    mine.parent.mkdir()
    mine.write_bytes(b"solid mine")
    with pytest.raises(FileError, match=r"nontextured.stl is there already, was not made here"):
        make(out, **simulated(["golf_ball", "strawberry"]))
    assert mine.read_bytes() == b"solid mine"
    assert read_manifest(out).entries


@pytest.mark.slow
def test_a_file_of_the_users_where_ours_would_go_stays(tmp_path):
    make(tmp_path / "whole", **simulated(["golf_ball"]))
    image = next((tmp_path / "whole").rglob("processed_image_edges.pkl")).relative_to(tmp_path / "whole")
    out = tmp_path / "out"
    plan = plan_dataset(small_recipe.recipe(**simulated(["golf_ball"])), out)
    (out / image).parent.mkdir(parents=True)
    (out / image).write_bytes(b"mine")
    done = run_plan(plan, HERE)
    assert [why for _, why in done.failures] == [
        f"{out / image} is there already, was not made here, and would be overwritten; move it away"
    ]
    assert (out / image).read_bytes() == b"mine"
    (out / image).write_bytes((tmp_path / "whole" / image).read_bytes())  # as a run leaves it that was killed just then
    assert make(out, **simulated(["golf_ball"])).failures == ()


@pytest.mark.slow
def test_what_a_changed_recipe_makes_no_more_goes_unless_it_was_changed(tmp_path):
    out = tmp_path / "out"
    make(out, **simulated(["golf_ball"]))
    gone = next(out.rglob("processed_image_edges.pkl"))
    one = {**small_recipe.table()["simulator"], "models": ["specular"]}
    make(out, **simulated(["golf_ball"], simulator=one))
    assert not gone.exists()
    make(out, **simulated(["golf_ball"]))
    gone.write_bytes(b"changed by hand")
    make(out, **simulated(["golf_ball"], simulator=one))
    assert gone.read_bytes() == b"changed by hand"


@pytest.mark.slow
def test_hidden_files_of_others_stay(tmp_path):
    out = tmp_path / "out"
    (out / ".partial").mkdir(parents=True)
    (out / ".partial" / "thesis.txt").write_text("mine")
    (tmp_path / "outside.txt").write_text("mine, too")
    (out / ".lock").symlink_to(tmp_path / "outside.txt")
    make(out, **simulated(["golf_ball"]))
    assert (out / ".partial" / "thesis.txt").read_text() == "mine"
    assert (tmp_path / "outside.txt").read_text() == "mine, too"
    for name in (JOURNAL_NAME, ".millisight.lock"):
        (out / name).symlink_to(tmp_path / "outside.txt")
        with pytest.raises(FileError, match="is a link|cannot write to"):
            make(out, **simulated(["strawberry"]))
        assert (tmp_path / "outside.txt").read_text() == "mine, too"
        (out / name).unlink()


def test_a_manifest_that_lost_a_line_is_damaged(tmp_path):
    """The jobs were taken for done, without the file."""
    out = tmp_path / "out"
    make(out, **simulated(["golf_ball"]))
    lines = (out / "manifest.jsonl").read_text().splitlines(keepends=True)
    (out / "manifest.jsonl").write_text("".join(line for line in lines if "processed_image_edges" not in line))
    with pytest.raises(DamagedFileError, match=r"lists \d+ files, \d+ by its first line; restore it, or remove it"):
        make(out, **simulated(["golf_ball"]))
    (out / "manifest.jsonl").write_text("".join(lines).replace('"kind": "image"', '"kind": "raw"', 1))
    with pytest.raises(DamagedFileError, match="was changed after it was written"):
        make(out, **simulated(["golf_ball"]))


@pytest.mark.parametrize("name", ["../other", "/tmp/other", "a\\b", ".hidden", ".."])
def test_a_recipe_is_called_as_a_folder_can_be(name):
    with pytest.raises(FormatError, match="expected the name of a folder"):
        small_recipe.recipe(name=name)


def test_too_many_jobs_are_refused_at_once(tmp_path):
    drawn = {"count": 10_000, "x_deg": [-180, 180], "y_deg": [-90, 90]}
    quick = [
        "cracker_box", "sugar_box", "pudding_box", "gelatin_box", "wood_block", "b_colored_wood_blocks", "large_marker",
        "foam_brick", "sponge", "b_marbles", "golf_ball",
    ]  # fmt: skip
    with pytest.raises(FormatError, match="it has 220000 jobs; expected 200000 at most"):
        plan_dataset(small_recipe.recipe(rig=None, objects={"names": quick}, poses=drawn, simulator={}), tmp_path)


@pytest.mark.slow
def test_minus_zero_is_zero():
    """NumPy draws from no range that ends at it."""
    recipe = small_recipe.recipe(**simulated(["golf_ball"], poses={"angles_deg": [[0, 0, 0]], "shift": -0.0}))
    assert jobs_of(recipe, prepare_objects(recipe))
