"""Every command that a page or a `--help` prints is one that the program takes, and runs where that takes seconds.

The commands of a page are run in its order, in one fresh folder with the files that a reader would have. Those of the
README are run in tests/system/test_first_hour.py.
"""

import glob
import os
import pkgutil
import re
import shutil

import matplotlib.pyplot as plt
import numpy as np
import pytest
import typer

import millisight as ms
from helpers.commands import COMMANDS, run_here
from helpers.printed import (
    COMPLETION,
    LEFT_OUT,
    README,
    ROOT,
    commands_in,
    locate_roughly,
    why_not,
    words_of,
    write_mesh,
    write_recording,
    write_scan,
)
from millisight.cli.app import app
from millisight.io.mito import write_published
from millisight.viz import save_figure

PAGES = [README, *sorted((ROOT / "docs").glob("*/*.md"))]


def examples_of(command):
    return re.findall(r"^ *Example: (millisight .*)$", command.callback.__doc__ or "", flags=re.MULTILINE)


OF_PAGES = {page.relative_to(ROOT).as_posix(): commands_in(page.read_text(encoding="utf-8")) for page in PAGES}
OF_PAGES = {page: lines for page, lines in OF_PAGES.items() if lines}
OF_HELP = {name: examples_of(command) for name, command in COMMANDS.items() if command.callback is not None}
PRINTS = {**OF_PAGES, **{f"{name} --help": lines for name, lines in OF_HELP.items() if lines}}
PROGRAM = typer.main.get_command(app)
PRINTED = sorted({line for lines in PRINTS.values() for line in lines})


def test_commands_are_found():
    assert len(OF_PAGES) > 15
    assert len(PRINTED) > 60
    assert sum(why_not(line) is None for line in PRINTED) > 30
    for pattern in LEFT_OUT:
        assert any(re.search(pattern, line) for line in PRINTED), f"nothing matches {pattern} any more"


@pytest.mark.parametrize("line", [line for line in PRINTED if not re.search(COMPLETION, line)])
def test_it_is_a_command_that_exists(line):
    context, words = PROGRAM.make_context("millisight", []), words_of(line)
    command = context.command
    while hasattr(command, "commands"):
        name, command, words = command.resolve_command(context, words)
        context = command.make_context(name, words, parent=context)


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """What a reader of the pages has: a mesh, its captures and images, files of a scanner.

    The mug is half as large as that of the catalogue, and so what is searched for it an eighth.
    """
    folder = tmp_path_factory.mktemp("stage")
    write_mesh(folder / "mug.stl", vertices=400, scale=0.5)
    mug = ms.Scene.from_mesh(folder / "mug.stl", unit="mm", vertices=None)
    trajectory = ms.Trajectory.raster(size=(0.06, 0.06), step=0.004)
    grid = ms.VoxelGrid.regular((-0.05, -0.05, -0.04), (0.05, 0.05, 0.04), 0.004)
    for band, name in (("77", "mito-sim-77ghz"), ("24", "mito-sim-24ghz")):
        capture = ms.simulate(mug, ms.Radar.preset(name), trajectory)
        ms.save(folder / f"mug_{band}.h5", ms.form_image(capture, grid))
        if band == "77":
            ms.save(folder / "mug.capture.h5", capture)
    for name in ("mug.image.h5", "carton.image.h5"):
        shutil.copy(folder / "mug_77.h5", folder / name)
    seen = ms.load(folder / "mug.image.h5").project()
    ms.save(folder / "mug.mask.h5", ms.Mask(grid_xy=grid.xy, inside=seen > 0.3 * seen.max()))
    for band, ending in (("77", "_specular"), ("24", "_edges")):
        write_published(folder / f"processed_image{ending}.pkl", ms.load(folder / f"mug_{band}.h5"))
    plt.imsave(folder / "photo.jpg", np.full((60, 80, 3), 0.5))
    write_scan(folder, folder / "scan.toml")
    write_scan(folder / "raw", folder / "my_scan.toml")
    shutil.copy(folder / "mug.capture.h5", folder / "scan.capture.h5")
    (folder / "images").mkdir()
    shutil.copy(folder / "mug.image.h5", folder / "images")
    for name in ("adc_data.bin", "iwr1443_adc_data20251124114141.bin"):
        write_recording(folder / name)
    return folder


QUICKER = {"simulate": {"vertices": 600}}
"""Defaults of options that cost time and change nothing else."""


def run_quickly(monkeypatch):
    """How well they find a pose, an image, and how fine a picture is, is tried elsewhere."""
    locate_roughly(monkeypatch)
    sparse = pkgutil.resolve_name("millisight.imaging._sparse:sparse")
    monkeypatch.setitem(sparse.__kwdefaults__, "iterations", 3)
    monkeypatch.setitem(save_figure.__kwdefaults__, "dpi", 40)


def of_second_kind(folder, names):
    """Parts of the miniature that pages name nowhere: second experiments, and the box out of sight."""
    return {"exp2", *(["nlos"] if "004_sugar_box" in folder else [])} & {*names}


RUN = [page for page, lines in PRINTS.items() if any(why_not(x) is None for x in lines) and page != README.name]


@pytest.mark.first
@pytest.mark.parametrize("page", RUN)
def test_what_is_printed_runs_in_its_order(page, stage, miniature, tmp_path, monkeypatch):
    for path in stage.iterdir():
        (shutil.copytree if path.is_dir() else shutil.copy)(path, tmp_path / path.name)
    if any("MITO_Dataset" in line for line in PRINTS[page]):
        shutil.copytree(miniature.healthy, tmp_path / "MITO_Dataset", ignore=of_second_kind)
    (tmp_path / "examples").symlink_to(ROOT / "examples", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0}, raising=False)  # one process: no others to be started
    run_quickly(monkeypatch)
    for line in PRINTS[page]:
        if why_not(line) is None:
            words = [one for word in words_of(line) for one in (sorted(glob.glob(word)) if "*" in word else [word])]
            code, out, err, error = run_here(*words, defaults=QUICKER)
            assert (code, error) == (0, ""), f"{line}\n{out}{err}{error}"
