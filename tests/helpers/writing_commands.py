"""Every command that writes, on as little as it takes: what `tests/faults.py` breaks off."""

import contextlib
import json
import os
import re
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest import mock

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
models = ["specular", "edge"]
vertices = 200
size = [0.1, 0.1]
margin = 0.01
step = 2.0
image = { spacing = [0.008, 0.008, 0.02], margin = 0.01 }
"""
SEEN = """
name = "seen"
seed = 3
[objects]
names = ["golf_ball"]
[rig]
conditions = ["los"]
keep = "captures"
margin = 0.02
image = { spacing = [0.008, 0.008, 0.02], margin = 0.01 }
[rig.world]
scan = { size = [0.1, 0.1], corner = [0.14, 0.25], row_spacing = 0.005 }
arm = { speed = 0.05 }
radars = [{ preset = "iwr1443", frame_period = 0.1 }]
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
SEGMENTER = """
name = "small"
widths = [8, 8, 8, 8]
batch = 4
views = 2
[scenes]
poses = 1
vertices = 200
positions = 400
without = {without}
validation = ["golf_ball"]
[whole]
views = 2
sheets = 0
[schedule]
epochs = 2
seed = 1
"""
CLASSIFIER = """
name = "tiny"
batch = 2
examples = 4
scenes = 2
vertices = 200
positions = 400
[classes]
box = ["dice"]
sphere = ["golf_ball", "plum"]
[whole]
views = 1
sheets = 0
[schedule]
epochs = 1
seed = 1
"""
SMALL_CAPTURE = ("--vertices", "200", "--radar", "mito-sim-24ghz", "--step", "10mm")


def as_record(path: Path) -> Any:
    """Of files that tell when they were made."""
    import millisight as ms
    from helpers.small_records import Comparable

    return Comparable(ms.load(path)) if path.suffix == ".h5" else path.read_bytes()


def without_keys(path: Path) -> bytes:
    """Of files with keys of results, in which the times of copied files are."""
    return re.sub(rb'"key": "\w+"', b"", path.read_bytes())


def without_numbers(path: Path) -> bytes:
    """Of files with the ports that were free."""
    return re.sub(rb"\d+", b"", path.read_bytes())


@dataclass(frozen=True)
class Command:
    """A command: its words, what it needs in its folder, and what of its outputs is compared."""

    name: str
    words: tuple[str, ...]
    prepare: Callable[[Path], None]
    outputs: tuple[str, ...]
    """Files, which are old or new after a fault; or folders, in which files may be missing."""
    compared: Callable[[Path], Any] = Path.read_bytes
    beside: Callable[[], None] = lambda: None
    """Called in the command's process before it, with its folder as the current one: a hub, a page, an arm."""
    adds: bool = False
    """A run after one that ended well adds to its outputs."""
    needs: str = ""
    """Module that must be installed."""
    passed_over: str = ""
    """Pattern of paths that are not compared."""

    @property
    def missing(self) -> bool:
        return bool(self.needs) and find_spec(self.needs) is None


def commands() -> list[Command]:
    """All of them."""
    nothing = Command("", (), lambda _: None, ()).prepare
    evaluated = ("-o", "out", "--workers", "1")
    published = "mito/MITO_Dataset"
    return [
        Command("simulate", ("simulate", "golf_ball", *SMALL_CAPTURE, "-o", "c.h5"), nothing, ("c.h5",), as_record),
        Command("image", ("image", "c.h5", "--grid", "1cm", "-o", "i.h5", "--plot", "i.png"), _capture,
                ("i.h5", "i.png"), as_record),
        # Without its picture, which takes longest: pictures are drawn by "image".
        Command("segment", ("segment", "a.image.h5", "--method", "classical", "--no-picture", "-o", "m.h5"), _image,
                ("m.h5",), as_record),
        # Its checksums stand with the times of the sources, which are copied anew for each run.
        Command("convert", ("dataset", "convert", "data", "-o", "out", "--workers", "1"), _empty_scene, ("out",),
                passed_over=r"out/\.millisight\.checksums\.json"),
        Command("collect", ("collect", "world.toml", "-o", "data", "--truth", "truth"), _world, ("data", "truth")),
        Command("generate", ("generate", "recipe.toml", "-o", "out", "--workers", "1", "--scheduler", "threads"),
                _recipe, ("out",)),
        Command("surface", ("surface", "c.h5", "--grid", VOXELS, "-o", "s.ply", "--points", "p.ply", "--depth",
                            "d.npz"), _ball, ("s.ply", "p.ply", "d.npz", "s.surface.png")),
        Command("locate", ("locate", "c.h5", "--grid", VOXELS, "--mesh", "golf_ball", "-o", "l.json",
                           "--placed", "l.ply", "--plot", "l.png"), _ball, ("l.json", "l.ply", "l.png")),
        Command("classify", ("classify", "a.h5", "--mask", "m.h5", "-o", "k.json"), _masked, ("k.json", "k.png")),
        Command("view", ("view", "a.image.h5", "--html", "v.html"), _image, ("v.html",)),
        Command("annotate", ("annotate", "a.image.h5", "--method", "classical"), _image,
                ("a.mask.h5", "a.prompts.json"), as_record, beside=_page_opened),
        Command("demo", ("demo", "-o", "demo"), nothing, ("demo",), as_record, beside=_smaller_demo),
        Command("evaluate segmentation", ("evaluate", "segmentation", "data", *evaluated, "--method", "classical",
                "--seeds", "1", "--object", "wide", "--sight", "los", "--failures", "1"), _scenes, ("out",),
                without_keys),
        Command("evaluate classification", ("evaluate", "classification", "data", *evaluated, "--method", "classical",
                "--mistakes", "1", "--sight", "los"), _scenes, ("out",), without_keys,
                beside=_timeless),
        Command("evaluate simulator", ("evaluate", "simulator", "--measured", "made", "--simulated", "made",
                *evaluated, "--radar", "24_ghz", "--fit", "fit.toml", "--clouds", "ply", "--pictures", "1"), _made,
                ("out", "fit.toml"), without_keys),
        Command("evaluate surface", ("evaluate", "surface", "seen", *evaluated, "--spacing", "6mm", "--failures", "1"),
                _seen, ("out",), without_keys),
        Command("evaluate pose", ("evaluate", "pose", "seen", *evaluated, "--spacing", "6mm", "--failures", "1"),
                _seen, ("out",), without_keys, beside=_timeless),
        Command("script", ("rig", "script", "rig.toml", "--start-file", "go", "-o", "s.lua"), _rig, ("s.lua",)),
        Command("photo", ("rig", "photo", "rig.toml", "-o", "board"), nothing, ("board",), without_numbers,
                beside=_arm_and_camera, adds=True, passed_over=r"board/\d+\.png"),
        Command("emulate", ("rig", "emulate", "world.toml", "-o", "rig.toml", "--seconds", "0.1"), _emulated,
                ("rig.toml", "rig.cfg"), without_numbers),
        Command("calibrate camera", ("calibrate", "camera", "board", "--board", "9x6", "--square", "20mm", "-o",
                                     "c.toml"), _board, ("c.toml",)),
        Command("calibrate radar", ("calibrate", "radar", "c.h5", "--target", "0cm,0cm,-30cm", "--sphere", "50mm",
                                    "-o", "r.toml"), _ball, ("r.toml",)),
        Command("download", ("dataset", "download", "mito", "--workers", "1"), nothing, ("mito",), beside=_hub,
                needs="huggingface_hub", passed_over=r"mito/\.cache/"),
        Command("train segmenter", ("train", "segmenter", "small.toml", "-o", "out"), _segmenter, ("out",),
                needs="torch"),
        Command("train classifier", ("train", "classifier", "tiny.toml", "-o", "out"), _classifier, ("out",),
                needs="torch"),
        Command("train released", ("train", "released", published, "-o", "out", "--epochs", "2", "--batch", "2"),
                _published, ("out",), beside=_small_network, needs="torch"),
    ]  # fmt: skip


def _capture(folder: Path) -> None:
    import millisight as ms

    scene = ms.Scene.from_mesh("golf_ball", vertices=200)
    path = ms.Trajectory.raster(size=(0.05, 0.05), step=0.005)
    ms.save(folder / "c.h5", ms.simulate(scene, ms.Radar.preset("mito-sim-24ghz"), path))


def _image(folder: Path) -> None:
    import millisight as ms
    from helpers.annotating import radar_image

    ms.save(folder / "a.image.h5", radar_image())


def _empty_scene(folder: Path) -> None:
    from helpers.miniature import EMPTY, make

    (folder / "data").mkdir()
    shutil.move(make(folder / "built").healthy / EMPTY, folder / "data" / EMPTY)
    shutil.rmtree(folder / "built")


def _world(folder: Path) -> None:
    (folder / "world.toml").write_text(WORLD)


def _emulated(folder: Path) -> None:
    (folder / "world.toml").write_text(WORLD.replace('"position2go"', '"iwr1443"'))


def _recipe(folder: Path) -> None:
    (folder / "recipe.toml").write_text(RECIPE)


def _generated(folder: Path, text: str) -> None:
    from millisight.datasets.generation import Engine, plan_dataset, read_recipe, run_plan

    recipe = folder.with_name("recipe.toml")
    recipe.write_text(text)
    run_plan(plan_dataset(read_recipe(recipe), folder), Engine("threads", 1, 1))


def _made(folder: Path) -> None:
    _generated(folder / "made", RECIPE)


def _seen(folder: Path) -> None:
    _generated(folder / "seen", SEEN)


def _ball(folder: Path) -> None:
    import millisight as ms
    from helpers import solid_mirrors

    ms.save(folder / "c.h5", solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.1, step=0.004, noise=0.3))


def _masked(folder: Path) -> None:
    import numpy as np

    import millisight as ms
    from helpers import small_images

    ms.save(folder / "a.h5", small_images.image())
    inside = np.zeros(small_images.GRID.xy.shape, bool)
    inside[small_images.BRIGHT] = True
    ms.save(folder / "m.h5", ms.Mask(grid_xy=small_images.GRID.xy, inside=inside))


def _scenes(folder: Path) -> None:
    from helpers import small_scenes

    small_scenes.make(folder / "data")


def _rig(folder: Path) -> None:
    from helpers.profiles import PROFILE

    (folder / "profile.cfg").write_text(PROFILE)
    (folder / "rig.toml").write_text(RIG)


def _board(folder: Path) -> None:
    import numpy as np
    from scipy.spatial.transform import Rotation

    from helpers import boards
    from millisight.calibration import add_picture

    turns = [Rotation.from_euler("xyz", angles, degrees=True) for angles in ((-9, -9, 0), (9, -9, 0), (-9, 9, 5))]
    told = boards.setup(rng := np.random.default_rng(1), turns=turns)
    for picture, place, turn in zip(boards.pictures_of(told, rng), told.positions, told.orientations, strict=True):
        add_picture(folder / "board", picture, place, turn, boards.OPTICS)


def _published(folder: Path) -> None:
    from helpers import published_mock

    published_mock.make(folder / "mito")


def _segmenter(folder: Path) -> None:
    from millisight.meshes import CATALOGUE

    without = json.dumps([name for name in CATALOGUE if name not in ("dice", "golf_ball")])
    (folder / "small.toml").write_text(SEGMENTER.format(without=without))


def _classifier(folder: Path) -> None:
    (folder / "tiny.toml").write_text(CLASSIFIER)


def _timeless() -> None:
    """Pages that tell how long it took are the same again."""
    from millisight.evaluation.tasks import classification, pose

    mock.patch.object(classification, "perf_counter", return_value=0.0).start()
    mock.patch.object(pose.time, "process_time", return_value=0.0).start()


def _small_network() -> None:
    """In the place of the paper's, which has 68 million weights."""
    import torch

    from millisight.perception.training.networks import _released

    class Small(torch.nn.Module):
        def __init__(self, classes: int) -> None:
            super().__init__()
            self.last = torch.nn.Linear(1, classes)

        def forward(self, x: Any) -> Any:
            return self.last(x.flatten(1).mean(dim=1, keepdim=True))

    mock.patch.object(_released, "ReleasedNetwork", Small).start()


def _smaller_demo() -> None:
    """Of one object and a small aperture, all in one process, whose steps are counted."""
    from millisight import datasets
    from millisight.cli import demo

    @contextlib.contextmanager
    def here(function: Callable[[Any], Any], thing: Any) -> Any:
        yield lambda: function(thing)

    mock.patch.multiple(demo, OBJECTS=("mug",), _SIZE=(0.06, 0.06)).start()
    mock.patch.object(datasets, "beside", here).start()


def _page_opened() -> None:
    """A browser that clicks, saves and leaves."""
    from http.client import HTTPConnection, HTTPException
    from urllib.parse import urlsplit

    from millisight import viz
    from millisight.viz import PageServer

    def page(address: str) -> None:
        url = urlsplit(address)
        with contextlib.suppress(OSError, HTTPException):  # of a command that was broken off
            still = HTTPConnection(url.netloc)
            still.request("GET", url.path + "open")
            stream = still.getresponse()
            for path in ("mask", "save"):
                asks = HTTPConnection(url.netloc)
                asked = {"method": "classical", "points": [[17, 11]], "positive": [True]}
                asks.request("POST", url.path + path, json.dumps(asked), {"Content-Type": "application/json"})
                asks.getresponse().read()
                asks.close()
            stream.close()
            still.close()

    def opened(address: str) -> bool:
        threading.Thread(target=page, args=(address,), daemon=True).start()
        return True

    mock.patch.object(viz, "open_browser", opened).start()
    mock.patch.dict(PageServer.wait.__kwdefaults__, grace=0.2).start()


def _hub() -> None:
    """The hub with four files, on this machine."""
    from helpers.small_hub import Hub

    files = {"004_sugar_box/nontextured.stl": b"solid\n", "README.md": b"# MITO\n"}
    files |= {f"004_sugar_box/{name}.pkl": name.encode() * 40_000 for name in ("first", "second")}
    os.environ["HF_ENDPOINT"] = Hub(files).__enter__().endpoint


def _arm_and_camera() -> None:
    """An arm that is emulated, with a camera that sees always the same."""
    import numpy as np

    from helpers import boards
    from millisight.core import record
    from millisight.data import CameraFrame
    from millisight.rig.drivers import DRIVERS, Driver
    from millisight.rig.emulators import EmulatedLab
    from millisight.rig.virtual import ArmSettings, RadarSettings, ScanSettings, World

    @record
    class Settings:
        """Keys of the camera."""

    class Camera:
        place: Any = None

        def __init__(self, settings: Any) -> None: ...

        def open(self) -> None: ...

        def shoot(self) -> CameraFrame:
            rgb = np.zeros((480, 640, 3), np.uint8)
            depth = np.zeros(rgb.shape[:2], np.uint16)
            return CameraFrame(rgb=rgb, depth=depth, pose=np.eye(4), intrinsics=boards.OPTICS)

        def close(self) -> None: ...

    DRIVERS._entries["drawn"] = Driver(kind="camera", settings=Settings, make=Camera)
    world = World(
        scan=ScanSettings(size=(0.004, 0.02), row_spacing=0.004),
        arm=ArmSettings(path_error=0.0, encoder_noise=0.0),
        radars=(RadarSettings(frame_period=0.01),),
    )
    lab = EmulatedLab(world, frames=lambda settings, trajectory: None)
    path = lab.__enter__().write(Path.cwd())
    path.write_text(path.read_text() + '\n[camera]\ndriver = "drawn"\n')
