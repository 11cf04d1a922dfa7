"""Every command that writes, broken off at every step: killed, ended, out of space, without rights, two at once.

    python tests/faults.py              all commands, every step
    python tests/faults.py image        one command
    python tests/faults.py --every 5    every fifth step

A process opens, renames, makes and removes files; Python tells of each (its audit events), and at one of them the fault
comes. Afterwards each output is what it was or what it is to become, the same command ends well, its outputs are those
of a run without a fault, and nothing else is left.
"""

import argparse
import contextlib
import errno
import importlib
import os
import resource
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))  # helpers

STEPS = {"open", "os.rename", "os.mkdir", "os.rmdir", "os.remove", "os.truncate", "os.link", "shutil.rmtree"}
FAULTS = ("kill", "terminate", "no space", "no rights")
WORLD = """
objects = [{ object = "golf_ball", at = [0.03, 0.07] }]
radars = [{ preset = "position2go", frame_period = 0.02, mount = [0, 0, 0] }]
scan = { size = [0.06, 0.06], corner = [0, 0.04], row_spacing = 0.03 }
arm = { speed = 0.5, acceleration = 5, settle = 0.05 }
"""
VOXELS = "-4cm:4cm:4mm,-4cm:4cm:4mm,-27.5cm:-23cm:3.75mm"
RECIPE = """
name = "least"
seed = 3
[objects]
names = ["golf_ball"]
[rig]
conditions = ["los"]
keep = "captures"
margin = 0.01
image = { spacing = [0.008, 0.008, 0.02], margin = 0.01 }
[rig.world]
scan = { size = [0.06, 0.06], corner = [0.14, 0.25], row_spacing = 0.03 }
arm = { speed = 0.5 }
radars = [{ preset = "position2go", mount = [0, 0, 0] }]
[simulator]
radars = ["24_ghz"]
models = ["specular"]
vertices = 200
size = [0.1, 0.1]
margin = 0.01
step = 2.0
image = { spacing = [0.008, 0.008, 0.02], margin = 0.01 }
"""
RIG = """
[scan]
size = [0.02, 0.1]
row_spacing = 0.01
[arm]
driver = "ur"
address = "x"
limits = { lower = [0.4, -0.3, 0.2], upper = [0.5, 0.0, 0.3] }
[[radars]]
driver = "dca1000"
start_file = "go"
profile = "profile.cfg"
"""
IN_MEMORY = Path("/dev/shm")


@dataclass(frozen=True)
class Command:
    """A command: its words, what it needs in its folder, and what of its outputs is compared."""

    name: str
    words: tuple[str, ...]
    prepare: Callable[[Path], None]
    outputs: tuple[str, ...]
    by_bytes: bool = True  # else as records: those files tell when they were made


def commands() -> list[Command]:
    """All of them, on as little as they take."""
    import numpy as np
    from scipy.spatial.transform import Rotation

    import millisight as ms
    from helpers import boards, small_images, small_scenes, solid_mirrors
    from helpers.annotating import radar_image
    from helpers.profiles import PROFILE
    from millisight.calibration import add_picture

    def capture(folder: Path) -> None:
        scene = ms.Scene.from_mesh("golf_ball", vertices=200)
        path = ms.Trajectory.raster(size=(0.05, 0.05), step=0.005)
        ms.save(folder / "c.h5", ms.simulate(scene, ms.Radar.preset("mito-sim-24ghz"), path))

    def image(folder: Path) -> None:
        ms.save(folder / "a.image.h5", radar_image())

    def dataset(folder: Path) -> None:
        from helpers.miniature import EMPTY, make

        (folder / "data").mkdir()
        shutil.move(make(folder / "built").healthy / EMPTY, folder / "data" / EMPTY)
        shutil.rmtree(folder / "built")

    def world(folder: Path) -> None:
        (folder / "world.toml").write_text(WORLD)

    def recipe(folder: Path) -> None:
        (folder / "recipe.toml").write_text(RECIPE)

    def ball(folder: Path) -> None:
        ms.save(folder / "c.h5", solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.1, step=0.004, noise=0.3))

    def masked(folder: Path) -> None:
        ms.save(folder / "a.h5", small_images.image())
        inside = np.zeros(small_images.GRID.xy.shape, bool)
        inside[small_images.BRIGHT] = True
        ms.save(folder / "m.h5", ms.Mask(grid_xy=small_images.GRID.xy, inside=inside))

    def scenes(folder: Path) -> None:
        small_scenes.make(folder / "data")

    def rig(folder: Path) -> None:
        (folder / "profile.cfg").write_text(PROFILE)
        (folder / "rig.toml").write_text(RIG)

    def board(folder: Path) -> None:
        turns = [Rotation.from_euler("xyz", angles, degrees=True) for angles in ((-9, -9, 0), (9, -9, 0), (-9, 9, 5))]
        told = boards.setup(rng := np.random.default_rng(1), turns=turns)
        for picture, place, turn in zip(boards.pictures_of(told, rng), told.positions, told.orientations, strict=True):
            add_picture(folder / "board", picture, place, turn, boards.OPTICS)

    vertices = ("--vertices", "200", "--radar", "mito-sim-24ghz", "--step", "10mm")
    return [
        Command("simulate", ("simulate", "golf_ball", *vertices, "-o", "c.h5"), lambda _: None, ("c.h5",), False),
        Command("image", ("image", "c.h5", "--grid", "1cm", "-o", "i.h5", "--plot", "i.png"), capture,
                ("i.h5", "i.png"), False),
        Command("segment", ("segment", "a.image.h5", "--method", "classical", "-o", "m.h5"), image, ("m.h5",), False),
        Command("convert", ("dataset", "convert", "data", "-o", "out", "--workers", "1"), dataset, ("out",)),
        Command("collect", ("collect", "world.toml", "-o", "data", "--truth", "truth"), world, ("data", "truth")),
        Command("generate", ("generate", "recipe.toml", "-o", "out", "--workers", "1", "--scheduler", "threads"),
                recipe, ("out",)),
        Command("surface", ("surface", "c.h5", "--grid", VOXELS, "-o", "s.ply", "--points", "p.ply", "--depth",
                            "d.npz"), ball, ("s.ply", "p.ply", "d.npz", "s.surface.png")),
        Command("locate", ("locate", "c.h5", "--grid", VOXELS, "--mesh", "golf_ball", "-o", "l.json",
                           "--placed", "l.ply", "--plot", "l.png"), ball, ("l.json", "l.ply", "l.png")),
        Command("classify", ("classify", "a.h5", "--mask", "m.h5", "-o", "k.json"), masked, ("k.json", "k.png")),
        Command("view", ("view", "a.image.h5", "--html", "v.html"), image, ("v.html",)),
        Command("evaluate", ("evaluate", "segmentation", "data", "-o", "out", "--method", "classical", "--seeds", "1",
                             "--object", "wide", "--sight", "los", "--workers", "1", "--failures", "1"), scenes,
                ("out",)),
        Command("script", ("rig", "script", "rig.toml", "--start-file", "go", "-o", "s.lua"), rig, ("s.lua",)),
        Command("camera", ("calibrate", "camera", "board", "--board", "9x6", "--square", "20mm", "-o", "c.toml"), board,
                ("c.toml",)),
    ]  # fmt: skip


def started(
    command: Command, folder: Path, *, fault: str = "", step: int = -1, most: int = 0, imported: Path | None = None
) -> Callable[[], tuple]:
    """Run it in a process of its own, with a fault at a step.

    Parameters
    ----------
    most : bytes that a file may take; 0: any
    imported : file into which the names of the modules go that it has imported

    Returns
    -------
    A function that waits for its end: exit code (-9 if killed), number of steps, what it said.
    """
    ours, its = os.pipe()
    words = tempfile.TemporaryFile("w+", errors="replace")  # noqa: SIM115
    process = os.fork()
    if not process:
        code = 1
        try:
            os.close(ours)
            os.chdir(folder)
            os.dup2(words.fileno(), 1)
            os.dup2(words.fileno(), 2)
            _watch(folder, fault, step, its)
            if most:
                signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
                resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
            code = _call(command.words)
            if imported is not None:
                imported.write_text("\n".join(sys.modules))
        finally:
            os._exit(code)
    os.close(its)

    def ended() -> tuple[int, int, str]:
        with open(ours, "rb") as pipe, words:
            steps = len(pipe.read())
            code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
            words.seek(0)
            return code, steps, words.read()

    return ended


def run(command: Command, folder: Path, **fault: Any) -> tuple[int, int, str]:
    """As `started`, to its end."""
    return started(command, folder, **fault)()


def _call(words: tuple[str, ...]) -> int:
    from millisight.cli.main import run as main

    sys.argv = ["millisight", *words]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def _watch(folder: Path, fault: str, step: int, told: int) -> None:
    """Count this process's steps of writing within the folder, a byte each to `told`; at one the fault comes."""
    at, place = 0, os.fspath(folder)

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal at
        if event not in STEPS or not isinstance(arguments[0], str | os.PathLike):
            return
        if event == "open" and not (isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)):
            return
        if not os.path.abspath(arguments[0]).startswith(place):
            return
        at += 1
        os.write(told, b".")
        if at - 1 != step:
            return
        if fault in ("kill", "terminate"):
            os.kill(os.getpid(), signal.SIGKILL if fault == "kill" else signal.SIGTERM)
        elif fault:
            number = errno.ENOSPC if fault == "no space" else errno.EACCES
            raise OSError(number, os.strerror(number), os.fspath(arguments[0]))

    sys.addaudithook(hook)


@contextlib.contextmanager
def prepared(command: Command, text: Path) -> Iterator[Callable[[], Path]]:
    """Makes a fresh folder with what the command needs, as often as it is called."""
    needed = text / "needed"
    needed.mkdir()
    process = os.fork()  # since a process whose kernels have run cannot be forked
    if not process:
        try:
            command.prepare(needed)
            os._exit(0)
        finally:
            os._exit(1)
    if os.waitpid(process, 0)[1]:
        raise RuntimeError(f"what {command.name} needs cannot be made")
    count = 0

    def fresh() -> Path:
        nonlocal count
        count += 1
        place = text / f"{count}" / "here"
        shutil.copytree(needed, place)
        return place

    yield fresh


def contents(command: Command, folder: Path) -> dict[str, Any]:
    """What the outputs hold, by path; the rest by name alone, so that litter is seen."""
    import millisight as ms
    from helpers.small_records import Comparable

    found: dict[str, Any] = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = path.relative_to(folder).as_posix()
        if name.split("/")[0] not in command.outputs:
            found[name] = None
        elif path.suffix == ".h5" and not command.by_bytes:
            found[name] = Comparable(ms.load(path))
        else:
            found[name] = path.read_bytes()
    return found


def check(command: Command, every: int, say: Callable[[str], object]) -> int:
    """How many runs were broken off; AssertionError's own kind is not used: RuntimeError says what is wrong."""
    place = IN_MEMORY if os.access(IN_MEMORY, os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=place) as text, prepared(command, Path(text)) as fresh:
        whole = fresh()
        imported = Path(text) / "imported"
        code, steps, said = run(command, whole, imported=imported)
        if code or not steps:
            raise RuntimeError(f"{command.name} ends with {code} after {steps} steps without a fault: {said}")
        for name in imported.read_text().splitlines():  # here once, and not in each process that is forked
            with contextlib.suppress(ImportError):
                importlib.import_module(name)
        expected, tried = contents(command, whole), 1
        for fault in FAULTS:
            for step in range(0, steps, every):
                _one(command, fresh(), expected, f"{fault} at step {step}", fault=fault, step=step)
                tried += 1
        for most in (512, 4096, 1 << 16):
            _one(command, fresh(), expected, f"files of at most {most} bytes", most=most)
            tried += 1
        _twice(command, fresh(), expected)
        say(f"{command.name}: {steps} steps, {tried} runs broken off, all gone on with, same outputs, nothing left\n")
        return tried


def _one(command: Command, folder: Path, expected: dict[str, Any], what: str, **fault: Any) -> None:
    code, _, said = run(command, folder, **fault)
    if "Traceback" in said:
        raise RuntimeError(f"{command.name}, {what}: {said}")
    if command.name not in ("convert", "generate", "collect", "evaluate"):  # whose outputs are folders
        for name, content in contents(command, folder).items():
            if name in command.outputs and content != expected[name]:
                raise RuntimeError(f"{command.name}, {what}: {name} is neither old nor new")
    again, _, words = run(command, folder)
    if again and "already exists" not in words:
        raise RuntimeError(f"{command.name}, {what} (exit code {code}): then it ends with {again}: {words}")
    found = contents(command, folder)
    young = [name for name in found if name not in expected and ".part" in name.rpartition("/")[2]]
    for name in young:  # a temporary file is swept when it is a minute old, a folder by the next run
        del found[name]
    if found != expected:
        differ = sorted(name for name in {*found, *expected} if found.get(name, "") != expected.get(name, ""))
        raise RuntimeError(f"{command.name}, {what}: then {differ[:5]} are others")
    shutil.rmtree(folder.parent)


def _twice(command: Command, folder: Path, expected: dict[str, Any]) -> None:
    """Two at once: one of them ends well, the other as well or refused by name, and the outputs are as of one."""
    ends = [started(command, folder), started(command, folder)]
    told = [end() for end in ends]
    if not any(code == 0 for code, _, _ in told):
        raise RuntimeError(f"{command.name}, two at once: {told}")
    for code, _, said in told:
        if code and not ("another run" in said or "already exists" in said):
            raise RuntimeError(f"{command.name}, two at once: one ends with {code}: {said}")
    if contents(command, folder) != expected:
        raise RuntimeError(f"{command.name}, two at once: the outputs are others")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="of commands; none: all")
    parser.add_argument("--every", type=int, default=1, help="how many steps to go on by")
    arguments = parser.parse_args()
    total = 0
    for command in commands():
        if not arguments.names or command.name in arguments.names:
            total += check(command, arguments.every, sys.stdout.write)
            sys.stdout.flush()
    sys.stdout.write(f"{total} runs broken off\n")


if __name__ == "__main__":
    main()
