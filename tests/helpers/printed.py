"""What the pages print: their commands, which of them a test runs, and the files that they take for granted."""

import itertools
import re
import shlex
from pathlib import Path

import numpy as np
import scipy.io
import trimesh

import millisight as ms
from helpers import small_scenes
from helpers.miniature import MUG, add_simulation, small_scene
from helpers.raw_scenes import scene
from millisight.io.mito import experiment_folder
from millisight.io.raw import write_dca1000

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"

COMPLETION = r"^millisight --(install|show)-completion"  # changes the settings of the shell that runs it
LEFT_OUT = {
    COMPLETION: "tests/cli/test_scripting.py asks for the lines",
    r"^millisight (view|annotate) (?!.*--html)": "serves a page until it is closed: tests/system/test_*_browser.py",
    r"--screenshot": "needs Chromium: tests/system/test_view_browser.py",
    r"^ssh ": "needs another machine",
    r"^millisight dataset (download|push)": "needs the hub or a store: tests/datasets has its own",
    r"^millisight train": "takes from minutes to an hour: tests/cli/test_train_*.py train small ones",
    r"^millisight (generate|collect) (?!.*--dry-run)": "takes minutes to hours: tests/cli has small ones",
    r"^millisight calibrate ": "needs a board or a target: tests/cli/test_calibrate*.py have them",
    r"^millisight rig |rig\.toml": "needs emulators that run beside it: tests/cli/test_rig.py has them",
    r"(?<!--)\b(bench24|unseen|surfaces|tiny|ball-or-box|mine|data|mito|both)\b|_ghz\.image": "made by one left out",
    r"\bgeometry24\b": "made by one left out",
    r"--method sam\b": "needs weights that a page tells how to get",
    r"\bFOLDER\b|letter_r_22ghz": "real captures: tests/imaging runs them where they are",
    r"\bhall\.": "takes minutes and gigabytes: tests/imaging/test_slabs.py has a small one",
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


def why_not(line):
    """Why a command is not run; None: it is."""
    return next((why for pattern, why in LEFT_OUT.items() if re.search(pattern, line)), None)


def words_of(line):
    """The words after `millisight`, up to a comment or another command."""
    words = shlex.split(line.split("millisight ", 1)[1], comments=True)
    return list(itertools.takewhile(lambda word: word not in ("&&", ">"), words))


def locate_roughly(monkeypatch):
    """As few turns, poses that are fitted, and axes of symmetry as the search for a pose takes."""
    monkeypatch.setitem(ms.locate.__kwdefaults__, "turns", 100)
    monkeypatch.setattr("millisight.geometry._registration.register.__kwdefaults__", {"most": 20, "climbers": 20})
    monkeypatch.setattr("millisight.geometry._locate._fits.__defaults__", (20,))
    monkeypatch.setattr("millisight.geometry._symmetries._AXES", 30)


def write_mesh(path, vertices=None, scale=1.0):
    """The catalogue's mug as a file of one's own, in millimetres."""
    mug = ms.Scene.from_mesh("mug", vertices=vertices).mesh
    trimesh.Trimesh(1e3 * scale * mug.vertices, mug.faces).export(path)


def write_scan(data, description):
    """A scan of a point, 30 cm under the middle, into the folder `data`, and the description that a page has of it."""
    told = (ROOT / "docs/how-to/your-own-scanner.md").read_text(encoding="utf-8")
    axes = [0.004 * (np.arange(count) - (count - 1) / 2) for count in (30, 20)]
    away = np.sqrt(axes[0][:, None] ** 2 + axes[1] ** 2 + 0.3**2)
    f = np.linspace(22, 26, 8)
    data.mkdir(exist_ok=True)
    scipy.io.savemat(
        data / "scan.mat", {"S": np.exp(2j * np.pi * 1e9 * f[:, None, None] * 2 * away / 299792458), "f": f}
    )
    description.write_text(re.findall(r"```toml\n(.*?)```", told, flags=re.DOTALL)[0], encoding="utf-8")


def write_recording(path):
    """A DCA1000's file."""
    write_dca1000(path, scene(np.random.default_rng(0)))


def write_scenes(folder):
    """A dataset of images that can be told apart, measured and simulated."""
    one, other = small_scenes.BLOCKS.values()
    for name, block, sight in ((MUG, one, "los"), (MUG, one, "nlos"), ("003_cracker_box", other, "los")):
        place = experiment_folder(folder, name, (0, 0, 0), 1, sight)
        small_scenes.add(place, block, small_scenes.INFO, hidden=sight == "nlos")
    add_simulation(folder, MUG, small_scene(MUG))
