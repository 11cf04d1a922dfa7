"""What every record shares: checks, read-only arrays and metadata, copies; and one way to compile."""

import copy
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from millisight import data
from millisight.core import checked_array, checked_integer, checked_metadata, checked_numbers
from millisight.core.errors import InputError
from millisight.meshes import ObjectPart

PACKAGE = Path(ms.__file__).parent


def test_a_read_only_view_of_a_writable_array_is_copied():
    base = np.zeros((4, 3))
    view = base[:2]
    view.flags.writeable = False
    array = checked_array(view, name="x", shape=("n", 3))
    base[0, 0] = 5
    assert array[0, 0] == 0
    base.flags.writeable = False
    assert checked_array(base, name="x", shape=("n", 3)) is base  # nobody can write to it: no copy


def test_an_array_behind_another_object_is_copied():
    class Wrapped:
        def __init__(self):
            self.inner = np.zeros(3)

        def __array__(self, dtype=None, copy=None):
            return self.inner

    wrapped = Wrapped()
    array = checked_array(wrapped, name="x", shape=(3,))
    wrapped.inner[0] = 5
    assert array[0] == 0


@pytest.mark.parametrize(
    ("value", "dtype", "message"),
    [
        ([0.5, 1], np.int64, "x cannot be read as an array of int64: it holds values that are not whole"),
        ([1j], np.float64, "x cannot be read .* complex"),
        ([10**400], np.float64, "x cannot be read"),
        ([[1], [1, 2]], np.float64, "x cannot be read"),
        (["a"], np.float64, "x cannot be read"),
        (np.array(["2026-11-25"], "M8[D]"), np.float64, "x cannot be read .* dates"),
        (np.ma.masked_array([1.0, 2], mask=[0, 1]), np.float64, "x cannot be read .* masked.* fill them"),
        ([1e300], np.complex64, "x has 1 values that are NaN or infinite"),
    ],
)
def test_what_is_no_array_is_refused(value, dtype, message):
    with pytest.raises(InputError, match=message):
        checked_array(value, name="x", shape=("n",), dtype=dtype)


def test_whole_numbers():
    assert [checked_integer(v, name="n") for v in (4, 4.0, np.int8(4), np.float32(4))] == [4] * 4
    for value in (0, 2.5, "4", True, None, np.nan, [4]):
        with pytest.raises(InputError, match="n is .*; expected a whole number of at least 1"):
            checked_integer(value, name="n")


def test_several_numbers():
    assert checked_numbers(2, name="n", count=2, repeat=True) == (2.0, 2.0)
    assert checked_numbers(np.array([1, 2]), name="n", count=2) == (1.0, 2.0)
    for value in (2, "12", None, {1: 2, 3: 4}, (1, 2, 3), (1, "a"), np.zeros(()), object()):
        with pytest.raises(InputError, match="n (is|has)"):
            checked_numbers(value, name="n", count=2)


def public_records():
    """One of each public record whose fields would make a long text."""
    scene = ms.Scene.from_mesh("golf_ball", vertices=200)
    radar, path = ms.Radar.preset("iwr1443"), ms.Trajectory.raster(size=(0.1, 0.1), step=0.01)
    capture = ms.Capture(radar=radar, trajectory=path, frames=np.zeros((121, 1, 4, 512), np.complex64))
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.4, 0.4, 0.1), 0.01)
    step = data.CalibrationStep(name="subtract", settings={"background": np.zeros((300, 2))})
    intrinsics = ms.Intrinsics(fx=600.0, fy=600.0, cx=320.0, cy=240.0, width=64, height=48)
    empty = {"depth": np.zeros((48, 64), np.uint16), "pose": np.eye(4)}
    return [
        scene, scene + scene + scene + scene, scene.objects[0], scene.objects[0].material, scene.mesh,
        data.MATERIALS["cardboard"], ObjectPart(name="lid", mesh=scene.mesh, material=scene.objects[0].material),
        radar, radar.array, radar.waveform, path, capture,
        grid, grid.xy, ms.SarImage(grid=grid, values=np.zeros(grid.shape)),
        ms.Mask(grid_xy=grid.xy, inside=np.ones(grid.xy.shape, bool)),
        ms.VolumeMask(grid=grid, inside=np.ones(grid.shape, bool)),
        ms.Instances(grid_xy=grid.xy, labels=np.ones(grid.xy.shape, int), scores=[1.0]),
        ms.Picture(rgb=np.zeros((40, 30, 3), np.uint8)), ms.PointCloud(points=np.zeros((500, 3))),
        ms.Prompts(points=np.zeros((1, 2), int), positive=[True]),
        ms.Prediction(probabilities=np.full(8, 0.125), class_names=tuple("abcdefgh")), intrinsics,
        ms.CameraFrame(intrinsics=intrinsics, rgb=np.zeros((48, 64, 3), np.uint8), **empty),
        ms.CameraMask(pixels=np.zeros((48, 64), bool), points=np.zeros((48, 64, 3)), **empty),
        ms.ClockCorrection(offset=0.02),
        ms.ScanRow(times=np.arange(5000.0), read=lambda: np.zeros(1), source="a.bin", missing=np.arange(5000) < 3),
        step, data.RawCapture(capture=capture, calibration=(step, step)),
        data.Layers(
            thicknesses=np.full(30, 0.01), indices=np.full(30, 1.5), normal=[0, 0, -1], moved=0, offset=0, error=0
        ),
        ms.Alignment(rotation=np.eye(3), translation=np.array([0.001, 0, 0]), rms=0.002, iterations=3, converged=True),
        ms.calibration.ReferenceTarget(position=[0.05, 0.04, -0.36], kind="sphere", radius=0.021335),
        ms.calibration.RadarCalibration(
            radar="iwr1443", path_offset=0.15012345, path_offset_uncertainty=0.0004, offset=(0.00512345, -0.004, 0.003),
            amplitudes=((1.0123456, 0.9876543, 1.1, 0.9),), phases=((0.0, 0.1234567, -2.0, 3.0),),
        ),
    ]  # fmt: skip


@pytest.mark.parametrize("one", public_records(), ids=lambda record: type(record).__name__)
def test_a_record_s_text_is_one_short_line(one):
    text = repr(one)
    assert text.startswith(f"{type(one).__name__}(")
    assert text.endswith(")")
    assert len(text) <= 200
    assert "\n" not in text
    assert "array(" not in text


def test_texts_say_sizes_units_and_extents():
    scene = ms.Scene.from_mesh("cracker_box", vertices=None)
    box = r"x -?[\d.]+ to [\d.]+ m, y -?[\d.]+ to [\d.]+ m, z -?[\d.]+ to [\d.]+ m"
    assert re.fullmatch(rf"Scene\(cracker_box of cardboard; {box}\)", repr(scene))
    four = scene + scene + scene + scene
    assert re.fullmatch(rf"Scene\((cracker_box of cardboard, ){{3}}1 more; {box}\)", repr(four))
    radar = ms.Radar.preset("iwr1443")
    assert repr(radar) == "Radar(iwr1443, 77.5001 to 80.4952 GHz in 512 samples, 1 TX x 4 RX, path offset 0.15 m)"
    assert repr(radar.array) == "AntennaArray(1 TX x 4 RX, x -0.0108 to 0 m, y 0 to 0 m, z 0 to 0 m)"
    row = ms.ScanRow(times=np.arange(5000.0), read=lambda: np.zeros(1), source="a.bin", missing=np.arange(5000) < 3)
    assert repr(row) == "ScanRow(a.bin, 5000 frames, 3 missing, 0 to 4999 s)"
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    moved = ms.Alignment(rotation=turned, translation=np.array([0.001, 0, 0]), rms=0.002, iterations=3, converged=False)
    assert repr(moved) == "Alignment(by (1, 0, 0) mm and 90 degrees, rms 2 mm, not converged)"


def test_metadata_cannot_be_changed_at_any_depth():
    given = {"history": [{"step": "made", "seed": 3, "numbers": [1, 2]}]}
    metadata = checked_metadata(given)
    given["history"][0]["seed"] = 4
    assert metadata["history"][-1]["seed"] == 3
    assert metadata == {"history": [{"step": "made", "seed": 3, "numbers": [1, 2]}]}
    for change in (
        lambda: metadata.update(a=1),
        lambda: metadata["history"].append({}),
        lambda: metadata["history"][0].__setitem__("seed", 4),
        lambda: metadata["history"][0]["numbers"].sort(),
    ):
        with pytest.raises(TypeError, match="metadata is read-only"):
            change()


@pytest.mark.parametrize("metadata", [3, {"history": 3}, {"history": ["made"]}, {"a": np.nan}, {"a": np.zeros(2)}])
def test_impossible_metadata_is_refused(metadata):
    with pytest.raises(InputError, match="metadata"):
        checked_metadata(metadata)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda r: pickle.loads(pickle.dumps(r))])  # noqa: S301
def test_copies_are_whole_and_read_only(copied):
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.01, 0.01, 0), 0.01)
    metadata = {"history": [{"step": "made", "seed": 3}]}
    image = ms.SarImage(grid=grid, values=np.arange(4).reshape(2, 2, 1), metadata=metadata)
    twin = copied(image)
    assert twin.metadata == metadata
    assert np.array_equal(twin.values, image.values)
    assert twin.grid.shape == grid.shape
    for array in (twin.values, twin.grid.x):
        assert not array.flags.writeable
    with pytest.raises(TypeError, match="read-only"):
        twin.metadata["history"][0]["seed"] = 4
    scene = copied(ms.Scene.from_mesh("cracker_box", vertices=None))
    assert scene.objects[0].name == "cracker_box"


def test_only_one_module_calls_numbas_compiler():
    """Elsewhere a cache that cannot be written to would end the import."""
    calls = re.compile(r"\bnjit\b|numba\.jit")
    found = [str(p.relative_to(PACKAGE)) for p in sorted(PACKAGE.rglob("*.py")) if calls.search(p.read_text("utf-8"))]
    assert found == ["core/_compiled.py"]


ECHOES = """
import hashlib
import millisight as ms
from millisight.meshes import build_object
from millisight.rig.virtual import Part, echoes
cube = Part(mesh=build_object("rubiks_cube"), material=2.7 - 0.02j)
radar, path = ms.Radar.preset("position2go"), ms.Trajectory.raster(size=0.02, step=0.01, center=(0, 0, 0.25))
frames = echoes([cube], radar, path, edges=False, bounces=1)
print(hashlib.sha256(frames.tobytes()).hexdigest())
"""
"""Of the kernels that these echoes need, `surface_echoes` is the one that LLVM makes differ."""

KEPT_IN = """
import sys
from numba.core import caching

class Locator(caching.UserProvidedCacheLocator):
    @classmethod
    def from_function(cls, function, path):
        if function.__name__ != "surface_echoes":
            return None  # the next locator finds it where it is kept already
        if not sys.argv[1]:
            raise RuntimeError("as where neither the package nor the home can be written to")
        caching.config.CACHE_DIR = sys.argv[1]
        try:
            return super().from_function(function, path)
        finally:
            caching.config.CACHE_DIR = ""

caching.CacheImpl._locator_classes = [Locator, *caching.CacheImpl._locator_classes]
"""
"""That one kernel is kept in this folder, or nowhere: it is compiled, and no other."""


def echoes_where(kept_in, more=""):
    """What a process prints, of its own, that keeps the kernel there."""
    done = subprocess.run(
        [sys.executable, "-c", KEPT_IN + ECHOES + more, str(kept_in)],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.fixture(scope="module")
def without_cache():
    """What a process prints that cannot keep the kernel, run once for two tests."""
    kernel = "from millisight.core import is_kept; from millisight.rig.virtual._kernels import surface_echoes"
    return echoes_where("", f"print(frames.any())\n{kernel}\nprint(is_kept(surface_echoes))")


@pytest.mark.slow
def test_the_rig_runs_where_no_machine_code_can_be_kept(without_cache):
    """That all runs where none of any kernel can be: tests/core/test_compiled.py."""
    assert without_cache[1:] == ["True", "False"]


@pytest.mark.slow
def test_machine_code_is_looked_for_where_numba_keeps_it(tmp_path):
    code = "from millisight.cli.console import kernels_cached; print(kernels_cached())"
    settings = {"NUMBA_CACHE_DIR": str(tmp_path), "PATH": ""}
    done = subprocess.run([sys.executable, "-c", code], env=settings, capture_output=True, text=True, timeout=120)
    assert done.stdout.split() == ["False"], done.stderr


@pytest.mark.slow
def test_a_process_that_compiles_computes_the_same_bytes_as_one_that_finds_machine_code(without_cache, tmp_path):
    """LLVM optimises a parallel loop twice; Numba ran the first result at once and the second ever after."""
    assert not list(tmp_path.rglob("*.nbi"))
    compiled = echoes_where(tmp_path)
    assert [path.name.split("-")[0] for path in tmp_path.rglob("*.nbi")] == ["_kernels.surface_echoes"]
    assert len(compiled[0]) == 64
    assert echoes_where(tmp_path) == compiled
    assert without_cache[0] == compiled[0]
