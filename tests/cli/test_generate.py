"""`millisight generate`: what it says before, after, and when something is wrong."""

import re

import pytest
import typer
from typer.testing import CliRunner

from helpers import small_recipe
from millisight.cli.generate import generate
from millisight.core.errors import FileError, FormatError, InputError, UnknownNameError
from millisight.datasets import read_manifest
from millisight.datasets.generation._simulator_job import SimulatorJob

app = typer.Typer()
app.command()(generate)

QUICK = """
name = "quick"
seed = 1
objects = { names = ["golf_ball", "strawberry"] }

[simulator]
radars = ["24_ghz"]
vertices = 200
size = [0.1, 0.2]
margin = 0.01
step = 3.0
image = { spacing = [0.01, 0.01, 0.02], margin = 0.01 }
"""


@pytest.fixture
def recipe(tmp_path):
    path = tmp_path / "recipe.toml"
    path.write_text(QUICK)
    return path


def run(*arguments):
    return CliRunner().invoke(app, [*map(str, arguments), "--workers", "1"])


@pytest.mark.slow
def test_it_tells_the_cost_makes_the_dataset_and_goes_on(recipe, tmp_path):
    out = tmp_path / "out"
    first = run(recipe, "-o", out)
    assert first.exit_code == 0, first.output
    lines = first.stdout.splitlines()
    assert lines[:2] == ["quick: 2 objects (2 from the catalogue)", "jobs: 2, of which 0 are done"]
    told = (
        r"estimate: \d+ s to \d+ s on one core, \d+ s to \d+ s on \d+, where nothing else runs; \d+ MB, and \d+ MB of "
    )
    assert re.fullmatch(told + "temporary files", lines[2])
    size = sum(entry.size for entry in read_manifest(out).entries.values())
    assert lines[3] == f"made 2 of 2 jobs; 0 were done before; 12 files, {size / 1e6:.1f} MB in {out}"
    again = run(recipe, "-o", out)
    assert "jobs: 2, of which 2 are done" in again.stdout
    assert "made 0 of 2 jobs; 2 were done before" in again.stdout


def test_a_dry_run_writes_nothing(recipe, tmp_path):
    done = run(recipe, "-o", tmp_path / "out", "--dry-run")
    assert done.exit_code == 0
    assert "estimate: " in done.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recipe.toml"]


@pytest.mark.parametrize(
    ("out", "said"),
    [
        ("file", "cannot write to the folder .*file: Not a directory"),
        ("file/data", "cannot make the folder .*data: Not a directory"),
        ("/proc/data", "cannot make the folder /proc/data: "),
    ],
)
def test_a_folder_that_cannot_be_made_is_told_before_the_work(out, said, recipe, tmp_path):
    (tmp_path / "file").write_text("")
    done = run(recipe, "-o", tmp_path / out, "--dry-run")
    assert isinstance(done.exception, FileError)
    assert re.search(said, str(done.exception))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "recipe.toml"]


def test_a_failure_is_told_at_the_end_and_by_the_exit_code(recipe, tmp_path, monkeypatch):
    make = SimulatorJob.make

    def fails(job, *arguments):
        if "golf" in job.key:
            raise InputError("the ball rolled away")
        make(job, *arguments)

    monkeypatch.setattr(SimulatorJob, "make", fails)
    done = run(recipe, "-o", tmp_path / "out")
    assert done.exit_code == 1
    assert "made 1 of 2 jobs" in done.stdout
    assert done.stderr.endswith("failed: 1\n  058_golf_ball/simulation/0_0_0/24_ghz: the ball rolled away\n")


@pytest.mark.parametrize(
    ("text", "error", "said"),
    [
        (QUICK.replace("strawberry", "strawbery"), FormatError, r"recipe.toml: objects: .*Did you mean 'strawberry'"),
        (QUICK.replace("step", "steps"), FormatError, r"recipe.toml: simulator.steps: .*Did you mean 'step'"),
        (
            QUICK.replace("[0.1, 0.2]", "[0.03, 0.2]"),
            InputError,
            r"cannot be generated: 012_strawberry.*cm wide",
        ),
        (
            QUICK + "\n[rig]\nworld = { scan = { size = [0.02, 0.5] } }",
            InputError,
            r"058_golf_ball.*aperture only 2.0 cm",
        ),
        ("name = ", FormatError, "recipe.toml is not valid TOML"),
        (small_recipe.TEXT.replace("carton", "paper"), FormatError, "unknown condition 'paper'"),
    ],
)
def test_a_bad_recipe_is_refused_before_the_work(text, error, said, recipe, tmp_path):
    recipe.write_text(text)
    done = run(recipe, "-o", tmp_path / "out")
    assert done.exit_code == 1
    assert isinstance(done.exception, error)
    assert re.search(said, str(done.exception)), done.exception
    assert not (tmp_path / "out").exists()


def test_an_unknown_scheduler_is_refused(recipe, tmp_path):
    done = run(recipe, "-o", tmp_path / "out", "--scheduler", "slurm")
    assert isinstance(done.exception, UnknownNameError)
    assert "Known: processes, tcp://host:8786, threads" in str(done.exception)
