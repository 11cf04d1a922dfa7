"""A dataset by workers that do not see its folder: files go through an object store, and the same bytes come out."""

import os
import pickle
import sys

import pytest
from typer.testing import CliRunner

from helpers import small_recipe
from helpers.printed import write_mesh
from helpers.small_cluster import Cluster
from millisight.cli.app import app
from millisight.core.errors import DeviceError, FileError, InputError
from millisight.datasets.generation import Engine, engine_of, plan_dataset, run_plan

fsspec = pytest.importorskip("fsspec", reason='needs fsspec: pip install "millisight[store]"')

HERE = Engine("threads", 1, 1)
JOBS = 4


class Watched:
    """Runs jobs here, as if it were elsewhere: what they are given must not tell of `out`; `then` sees each outcome."""

    workers = 1

    def __init__(self, out, then=lambda _: None):
        self._out, self._then, self.items = os.fsencode(out), then, 0

    def run(self, function, things):
        travelling = pickle.dumps((function, list(things)))
        assert self._out not in travelling
        self.items += len(things)
        for outcome in HERE.run(*pickle.loads(travelling)):  # noqa: S301
            self._then(outcome)
            yield outcome


def contents(folder):
    paths = [p for p in folder.rglob("*") if p.is_file() and not p.name.startswith(".")]
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in paths}


def plan(out, **changes):
    return plan_dataset(small_recipe.recipe(**changes), out)


def left_in(url):
    files, root = fsspec.core.url_to_fs(url, use_listings_cache=False, skip_instance_cache=True)
    return files.find(root)


@pytest.fixture(scope="module")
def made(small_dataset):
    """The small recipe's dataset, made without a store."""
    out, done, _ = small_dataset
    assert done.failures == ()
    return out


@pytest.mark.slow
def test_the_same_bytes_come_out_and_nothing_stays_in_the_store(made, tmp_path):
    engine, url = Watched(tmp_path / "out"), f"memory://{tmp_path.name}/store"
    calls = []
    done = run_plan(plan(tmp_path / "out"), engine, store=url, progress=lambda *count: calls.append(count))
    assert (done.made, done.failures, engine.items, len(calls)) == (JOBS, (), JOBS, JOBS)
    assert contents(tmp_path / "out") == contents(made)
    assert not (tmp_path / "out" / ".millisight.partial").exists()
    assert left_in(url) == []


@pytest.mark.slow
def test_meshes_of_ones_own_travel_too(tmp_path):
    write_mesh(tmp_path / "mine.stl", vertices=300)
    table = small_recipe.table(rig=None, objects=None, files=[{"path": str(tmp_path / "mine.stl"), "unit": "mm"}])
    recipe = small_recipe.recipe_from_table(table)
    run_plan(plan_dataset(recipe, tmp_path / "here"), HERE)
    engine = Watched(tmp_path / "away")
    done = run_plan(plan_dataset(recipe, tmp_path / "away"), engine, store=f"memory://{tmp_path.name}")
    assert (done.made, done.failures, engine.items) == (1, (), 1)
    assert contents(tmp_path / "away") == contents(tmp_path / "here")


@pytest.mark.slow
def test_what_is_damaged_on_the_way_is_done_again_the_next_time(tmp_path):
    url, out = f"memory://{tmp_path.name}/store", tmp_path / "out"
    quick = {"rig": None, "objects": {"names": ["golf_ball", "strawberry"]}}

    def damage(outcome):
        files = fsspec.filesystem("memory")
        for path in files.find(f"/{tmp_path.name}/store"):
            if "golf" in path and path.endswith("processed_image_edges.pkl"):
                files.pipe_file(path, files.cat_file(path)[::-1])

    done = run_plan(plan(out, **quick), Watched(out, damage), store=url)
    ((job, reason),) = done.failures
    assert "golf" in job
    assert "came with other bytes" in reason
    assert not (out / "058_golf_ball" / "simulation").exists()
    again = run_plan(plan(out, **quick), Watched(out), store=url)
    assert (again.made, again.kept, again.failures) == (1, 1, ())
    run_plan(plan(tmp_path / "here", **quick), HERE)
    assert contents(out) == contents(tmp_path / "here")
    assert left_in(url) == []


def test_a_job_that_fails_is_told_as_without_a_store(tmp_path, monkeypatch):
    def fails(*_):
        raise InputError("the ball rolled away")

    monkeypatch.setattr("millisight.datasets.generation._simulator_job.SimulatorJob.make", fails)
    done = run_plan(plan(tmp_path / "out", rig=None), HERE, store=f"memory://{tmp_path.name}")
    assert [reason for _, reason in done.failures] == ["the ball rolled away"]


def test_names_from_workers_that_lead_out_of_the_folder_are_refused(tmp_path):
    def evil(engine):
        class Evil(Watched):
            def run(self, function, things):
                for number, (entries, took), failure in super().run(function, things):
                    yield type(made_outcome)(number, ((*entries, entries[0]._replace(path="../evil")), took), failure)

        made_outcome = next(HERE.run(len, [""]))
        return Evil(engine)

    done = run_plan(plan(tmp_path / "out", rig=None), evil(tmp_path / "out"), store=f"memory://{tmp_path.name}")
    assert ["would lie outside the folder" in reason for _, reason in done.failures] == [True]
    assert not list(tmp_path.rglob("evil"))


@pytest.mark.slow
def test_a_store_that_cannot_be_used_is_told_before_the_work(s3, tmp_path, monkeypatch):
    engine = Watched(tmp_path / "out")
    with pytest.raises(FileError, match="there is no such bucket"):
        run_plan(plan(tmp_path / "out", rig=None), engine, store="s3://nosuchbucket/run")
    with pytest.raises(InputError, match="no protocol nowhere://"):
        run_plan(plan(tmp_path / "out", rig=None), engine, store="nowhere://run")
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(DeviceError, match=r'pip install "millisight\[store\]"'):
        run_plan(plan(tmp_path / "out", rig=None), engine, store="s3://bucket/run")
    assert engine.items == 0


@pytest.fixture
def cluster(s3, tmp_path_factory):
    """Workers that have the store's address and keys."""
    pytest.importorskip("distributed", reason='needs Dask: pip install "millisight[cluster]"')
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.end()


@pytest.mark.slow
def test_a_cluster_makes_the_same_bytes_by_way_of_s3_though_a_worker_is_killed(made, cluster, s3, tmp_path):
    engine = engine_of(cluster.of(2))

    def kill_one(*_):
        if len(cluster.workers) == 2:
            cluster.kill_one()

    done = run_plan(plan(tmp_path / "out"), engine, store="s3://bucket/runs", progress=kill_one)
    assert (done.made, done.failures, len(cluster.workers)) == (JOBS, (), 1)
    assert contents(tmp_path / "out") == contents(made)
    assert {name.split("/")[0] for name in s3.sent} == {"runs"}
    assert s3.names() == []


def test_the_command_takes_a_store(tmp_path):
    before, _, rest = small_recipe.TEXT.partition("[rig]")
    (tmp_path / "small.toml").write_text(before + rest[rest.index("[simulator]") :])
    words = ["generate", tmp_path / "small.toml", "-o", tmp_path / "out", "--scheduler", "threads", "--workers", "1"]
    told = CliRunner().invoke(app, [*map(str, words), "--store", f"memory://{tmp_path.name}/store"])
    assert told.exit_code == 0, told.output
    assert "made 1 of 1 jobs" in told.stdout
    assert len([path for path in fsspec.filesystem("memory").find("/") if f"/{tmp_path.name}/" in path]) == 0
    run_plan(plan(tmp_path / "here", rig=None), HERE)
    assert contents(tmp_path / "out") == contents(tmp_path / "here")
