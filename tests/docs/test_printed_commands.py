"""Every command that a page or a `--help` prints is one that the program takes, and runs where that takes seconds.

The commands of a page are run in its order, in one fresh folder with the files that a reader would have.
"""

import glob
import itertools
import re
import shlex
import shutil
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import scipy.io
import trimesh
import typer

import millisight as ms
from helpers import small_scenes
from helpers.commands import COMMANDS, run_here
from helpers.miniature import MUG, add_simulation, small_scene
from helpers.raw_scenes import scene
from millisight.cli.app import app
from millisight.io.mito import experiment_folder, write_published
from millisight.io.raw import write_dca1000

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*/*.md"))]

COMPLETION = r"^millisight --(install|show)-completion"  # changes the settings of the shell that runs it
LEFT_OUT = {
    COMPLETION: "tests/cli/test_scripting.py asks for the lines",
    r"^millisight (view|annotate) (?!.*--html)": "serves a page until it is closed: tests/system/test_*_browser.py",
    r"--screenshot": "needs Chromium: tests/system/test_view_browser.py",
    r"^ssh ": "needs another machine",
    r"^millisight dataset download": "needs the hub: tests/datasets has one of its own",
    r"^millisight train": "takes from minutes to an hour: tests/cli/test_train_*.py train small ones",
    r"^millisight (generate|collect) (?!.*--dry-run)": "takes minutes to hours: tests/cli has small ones",
    r"\b(bench24|unseen|tiny|ball-or-box|mine|data|mito|both)\b|_ghz\.image": "made by a command that is left out",
    r"--method sam\b": "needs weights that a page tells how to get",
    r"\bFOLDER\b|letter_r_22ghz": "real captures: tests/imaging runs them where they are",
    r"^millisight demo": "tests/system/test_main_job.py runs it",
    r"(classify|evaluate (segmentation|classification)) .*MITO_Dataset": "the images of the miniature are too coarse",
}
"""Patterns of commands that are only parsed, and why they are not run."""


def commands_in(text):
    """The `millisight` commands of a page's blocks, as printed, continued lines joined."""
    found = []
    for kind, block in re.findall(r"^ *```(sh|console)\n(.*?)^ *```", text, flags=re.DOTALL | re.MULTILINE):
        lines = re.sub(r"\\\n\s*", " ", block).splitlines()
        found += [line.removeprefix("$ ") for line in map(str.strip, lines) if kind == "sh" or line.startswith("$ ")]
    return [line for line in found if re.match(r"(ssh .*)?millisight ", line)]


def examples_of(command):
    return re.findall(r"^ *Example: (millisight .*)$", command.callback.__doc__ or "", flags=re.MULTILINE)


OF_PAGES = {page.relative_to(ROOT).as_posix(): commands_in(page.read_text(encoding="utf-8")) for page in PAGES}
OF_PAGES = {page: lines for page, lines in OF_PAGES.items() if lines}
OF_HELP = {name: examples_of(command) for name, command in COMMANDS.items() if command.callback is not None}
PRINTS = {**OF_PAGES, **{f"{name} --help": lines for name, lines in OF_HELP.items() if lines}}
PRINTED = sorted({line for lines in PRINTS.values() for line in lines})


def why_not(line):
    """Why a command is not run; None: it is."""
    return next((why for pattern, why in LEFT_OUT.items() if re.search(pattern, line)), None)


def words_of(line):
    """The words after `millisight`, up to a comment or another command."""
    words = shlex.split(line.split("millisight ", 1)[1], comments=True)
    return list(itertools.takewhile(lambda word: word not in ("&&", ">"), words))


def test_commands_are_found():
    assert len(OF_PAGES) > 15
    assert len(PRINTED) > 60
    assert sum(why_not(line) is None for line in PRINTED) > 30
    for pattern in LEFT_OUT:
        assert any(re.search(pattern, line) for line in PRINTED), f"nothing matches {pattern} any more"


@pytest.mark.parametrize("line", [line for line in PRINTED if not re.search(COMPLETION, line)])
def test_it_is_a_command_that_exists(line):
    context, words = typer.main.get_command(app).make_context("millisight", []), words_of(line)
    command = context.command
    while hasattr(command, "commands"):
        name, command, words = command.resolve_command(context, words)
        context = command.make_context(name, words, parent=context)


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """What a reader of the pages has: a mesh, its captures and images, files of a scanner."""
    folder = tmp_path_factory.mktemp("stage")
    mug = ms.Scene.from_mesh("mug", vertices=600)
    trimesh.Trimesh(1e3 * mug.mesh.vertices, mug.mesh.faces).export(folder / "mug.stl")
    trajectory = ms.Trajectory.raster(size=(0.1, 0.1), step=0.004)
    grid = ms.VoxelGrid.regular((-0.08, -0.08, -0.06), (0.08, 0.08, 0.06), 0.004)
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
    # As the page on one's own scanner has it.
    told = (ROOT / "docs/how-to/your-own-scanner.md").read_text(encoding="utf-8")
    toml = re.findall(r"```toml\n(.*?)```", told, flags=re.DOTALL)[0]
    axes = [0.004 * (np.arange(count) - (count - 1) / 2) for count in (60, 40)]
    away = np.sqrt(axes[0][:, None] ** 2 + axes[1] ** 2 + 0.3**2)
    f = np.linspace(22, 26, 8)
    held = {"S": np.exp(2j * np.pi * 1e9 * f[:, None, None] * 2 * away / 299792458), "f": f}
    for place, name in ((folder, "scan.toml"), (folder / "raw", "../my_scan.toml")):
        place.mkdir(exist_ok=True)
        scipy.io.savemat(place / "scan.mat", held)
        (place / name).write_text(toml, encoding="utf-8")
    shutil.copy(folder / "mug.capture.h5", folder / "scan.capture.h5")
    (folder / "images").mkdir()
    shutil.copy(folder / "mug.image.h5", folder / "images")
    for name in ("adc_data.bin", "iwr1443_adc_data20251124114141.bin"):
        write_dca1000(folder / name, scene(np.random.default_rng(0)))
    return folder


@pytest.mark.parametrize("page", [page for page, lines in PRINTS.items() if any(why_not(x) is None for x in lines)])
def test_what_is_printed_runs_in_its_order(page, stage, miniature, tmp_path, monkeypatch):
    for path in stage.iterdir():
        (shutil.copytree if path.is_dir() else shutil.copy)(path, tmp_path / path.name)
    shutil.copytree(miniature.healthy, tmp_path / "MITO_Dataset")
    for name, block in zip((MUG, "003_cracker_box"), small_scenes.BLOCKS.values(), strict=True):
        for sight in ("los", "nlos"):
            folder = experiment_folder(tmp_path / "DATASET", name, (0, 0, 0), 1, sight)
            small_scenes.add(folder, block, small_scenes.INFO, hidden=sight == "nlos")
    add_simulation(tmp_path / "DATASET", MUG, small_scene(MUG))
    experiment = f"{MUG}/robot_collected/0_0_90/exp1"
    (tmp_path / "exp1").symlink_to(tmp_path / "MITO_Dataset" / experiment, target_is_directory=True)
    (tmp_path / "examples").symlink_to(ROOT / "examples", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    for line in PRINTS[page]:
        if why_not(line) is None:
            words = [one for word in words_of(line) for one in (sorted(glob.glob(word)) if "*" in word else [word])]
            code, out, err, error = run_here(*words)
            assert (code, error) == (0, ""), f"{line}\n{out}{err}{error}"
