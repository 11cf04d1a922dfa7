"""Numbers at the edge of what they hold: refused by the command line as by Python, in the same words, before work."""

import copy
import shutil
import time

import pytest

import millisight as ms
from helpers import small_recipe, solid_mirrors
from helpers.commands import run_here
from millisight.core.errors import InputError, MillisightError
from millisight.datasets.generation import plan_dataset, recipe_from_table
from millisight.rig.virtual import VirtualRig, World

RADAR = ms.Radar.preset("mito-sim-24ghz")
SIMULATE = ("simulate", "golf_ball", "--vertices", "100", "--radar", RADAR.name, "-o", "o.h5")
IMAGE = ("image", "c.h5", "-o", "o.h5", "--grid")
BOX = "0m:1cm:{0}m,0m:1cm:{0}m,0m:1cm:{0}m"
BEYOND = "9" * 400
"""Infinite as a float."""


def grid(upper, spacing=0.01):
    return ms.VoxelGrid.regular((0, 0, 0), (upper, 0.01, 0.01), spacing)


def formed(tolerance):
    return ms.form_image(ms.load("c.h5"), grid(0.01), tolerance=tolerance)


def simulated(**options):
    trajectory = ms.Trajectory.raster(size=0.0, step=0.1)
    return ms.simulate(ms.Scene.from_mesh("golf_ball", vertices=100), RADAR, trajectory, rng=0, **options)


SAME = {
    "step": ((*SIMULATE, "--step={}m"), lambda x: ms.Trajectory.raster(size=(0.3, 0.22), step=x),
             ("-1e38", "1e-320", "0", BEYOND)),
    "aperture": ((*SIMULATE, "--step=10cm", "--aperture={0}x{0}m"), lambda x: ms.Trajectory.raster(size=x, step=0.1),
                 ("1e38", "-1e38", "3.4e38", "1e308", BEYOND)),
    "snr_db": ((*SIMULATE, "--step=10cm", "--snr-db={}"), lambda x: simulated(snr_db=x),
               ("nan", "inf", "1e38", "-1e38", "1e308", BEYOND)),
    "tau_deg": ((*SIMULATE, "--step=10cm", "--tau-deg={}"), lambda x: simulated(tau_deg=x),
                ("nan", "inf", "1e38", "-1e38", "0", BEYOND)),
    "spacing": ((*IMAGE, BOX), lambda x: grid(0.01, x), ("-1e38", "1e-45", "1e-320", "0", "1e-9", BEYOND)),
    "upper": ((*IMAGE, "0m:{}m:1cm,0m:1cm:1cm,0m:1cm:1cm"), grid, ("1e38", "-1e38", "3.4e38", "1e308", "1e8", BEYOND)),
    "tolerance": ((*IMAGE, BOX.format("0.01"), "--tolerance={}"), formed,
                  ("nan", "1e38", "-1e38", "1e-45", "1e-320", "0", "1e308", BEYOND)),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("numbers")
    ms.save(folder / "c.h5", solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.02, step=0.01))
    return folder


@pytest.mark.parametrize("name", SAME)
def test_absurd_numbers_are_refused_in_the_same_words(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    words, python, values = SAME[name]
    assert len(values) >= 4
    for value in values:
        began = time.process_time()
        code, _, _, told = run_here(*(word.format(value) for word in words))
        with pytest.raises(InputError) as refused:
            python(float(value))
        assert (code, told) == (1, str(refused.value))
        assert len(told) < 250
        assert time.process_time() - began < 5
    assert [path.name for path in folder.iterdir()] == ["c.h5"]


@pytest.mark.parametrize("value", ["1e-320", "1e-45", "1e3", "1e9"])
def test_what_can_be_meant_is_done(value):
    """A box narrower than a voxel is one voxel; and any aperture smaller than a step is one position."""
    size, step = (float(value), 0.01) if float(value) < 1 else (0.3, float(value))
    assert len(ms.Trajectory.raster(size=size, step=step)) == 1
    assert ms.VoxelGrid.regular((0, 0, 0), (size, 0, 0), step).shape == (1, 1, 1)


@pytest.mark.parametrize("length", [1e200, 1e308, 1e-320, 0.0, 1e38])
def test_turns_of_absurd_length_are_refused_without_a_warning(length):
    from millisight.calibration import PosedPicture
    from millisight.rig import ArmPose

    turn = (0.0, 0.0, 0.0, length)
    for make in (
        lambda: ms.Trajectory(times=[0.0], positions=[[0, 0, 0]], orientations=[turn]),
        lambda: ArmPose(position=(0, 0, 0), orientation=turn),
        lambda: PosedPicture(file="1.png", position=(0, 0, 0), orientation=turn),
        lambda: ms.PointCloud(points=[[0, 0, 0]], magnitude=[1.0], normals=[turn[1:]]),
    ):
        with pytest.raises(InputError, match="unit"):
            make()


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        (("image", "c.h5", "-o", "o.h5"), ", or pass --memory"),
        (("surface", "c.h5", "-o", "o.ply"), ""),
        (("locate", "c.h5", "--mesh", "golf_ball", "-o", "o.json"), ""),
    ],
    ids=lambda given: given[0] if given else "",
)
def test_ten_thousand_million_voxels_are_refused_before_work(words, advice, folder, monkeypatch):
    monkeypatch.chdir(folder)
    axis = "0m:21.54cm:0.1mm"
    began = time.process_time()
    code, _, _, told = run_here(*words, "--grid", f"{axis},{axis},{axis}")
    assert time.process_time() - began < 5
    assert code == 1
    assert "the image of 1e+10 voxels takes about" in told
    assert told.endswith(f"use a coarser --grid{advice}")
    assert [path.name for path in folder.iterdir()] == ["c.h5"]


WORLD = {
    "objects": [{"object": "rubiks_cube", "at": [0.05, 0.09], "rotate_deg": [0.0, 0.0, 30.0]}],
    "radars": [{"preset": "position2go", "frame_period": 0.02, "mount": [0.0, 0.0, 0.0]}],
    "scan": {"size": [0.1, 0.1], "corner": [0.0, 0.04], "row_spacing": 0.03},
    "arm": {"speed": 0.5, "acceleration": 5.0, "settle": 0.05, "path_error": 0.0001, "clock_drift": 1e-6},
    "carton": {"size": [0.2, 0.2, 0.1], "thickness": 0.003, "clearance": 0.01, "tilt_deg": [0.1, 0.2]},
    "cloth": {"layers": 2, "gap": 0.001},
}
ABSURD = (1e38, -1e38, 1e308, 1e-320, float("inf"), float("nan"), 1 << 70)


def with_each_number(table, absurd=ABSURD):
    """(path, copies of the table in which that number is an absurd one) of every number in a table."""

    def places(value, path):
        if isinstance(value, dict | list):
            for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
                yield from places(inner, (*path, key))
        elif isinstance(value, int | float):
            yield path

    for path in places(table, ()):
        copies = []
        for number in absurd:
            whole = inner = copy.deepcopy(table)
            for key in path[:-1]:
                inner = inner[key]
            inner[path[-1]] = number
            copies.append(whole)
        yield path, copies


def refused_or_done(make):
    """Whether it was refused: shortly, at once, by an error of ours; warnings are errors in all tests."""
    began, told = time.process_time(), ""
    try:
        make()
    except MillisightError as error:
        told = str(error)
    assert len(told) < 700
    assert time.process_time() - began < 5
    return bool(told)


@pytest.mark.slow
def test_worlds_with_absurd_numbers_are_refused_or_defined():
    refused = []
    for _, tables in with_each_number(WORLD):
        for table in tables:
            refused.append(refused_or_done(lambda table=table: VirtualRig(World.from_table(table, source="w"))))
    assert len(refused) >= 180
    assert sum(refused) > 0.8 * len(refused)


@pytest.mark.slow
def test_recipes_with_absurd_numbers_are_refused_or_defined(tmp_path):
    refused = []
    rig = {**small_recipe.table()["rig"], "conditions": ["los"]}
    recipe = {
        **small_recipe.table(rig=rig),
        "poses": {"count": 1, "z_deg": [0, 90], "shift": 0.01},
    }
    for _, tables in with_each_number(recipe, (1e38, 1e308, 1e-320, float("nan"))):
        for table in tables:
            refused.append(
                refused_or_done(lambda table=table: plan_dataset(recipe_from_table(table), tmp_path / "out"))
            )
    assert len(refused) >= 100
    assert sum(refused) > 0.8 * len(refused)


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ("view", "i.h5", "--html", "v.html", "--{threshold,range,opacity}={}", "--{depth,clip-x,clip-y}={}m:"),
        ("surface", "c.h5", "-o", "s.ply", "--{false-alarms,frequency}={}", "--{support,spacing,base,grid}={}m"),
        ("locate", "c.h5", "-o", "l.json", "--mesh=golf_ball", "--{false-alarms}={}", "--{support,grid}={}m"),
    ],
    ids=lambda words: words[0],
)
def test_options_with_absurd_numbers_are_refused_or_defined(words, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(folder / "c.h5", tmp_path)
    ms.save(
        "i.h5", ms.form_image(ms.load("c.h5"), ms.VoxelGrid.regular((-0.02, -0.02, -0.27), (0.02, 0.02, -0.23), 0.005))
    )
    fixed = [word for word in words if "{" not in word]
    tried = 0
    for word in words:
        names, _, pattern = word.partition("}=")
        for option in names.removeprefix("--{").split(",") if pattern else ():
            for value in ("1e38", "-1e38", "1e308", "1e-320", "nan", BEYOND):
                code, _, _, told = run_here(*fixed, f"--{option}={pattern.format(value)}")
                assert code in (0, 1, 2)
                assert len(told) < 500
                tried += 1
    assert tried >= 18


def test_what_is_of_another_type_is_refused_by_an_error_of_ours(folder):
    capture = ms.load(folder / "c.h5")
    box = ms.VoxelGrid.regular((-0.02, -0.02, -0.27), (0.02, 0.02, -0.23), 0.01)
    image = ms.form_image(capture, box)
    for make in (
        lambda: ms.Mask(grid_xy=3, inside=[[True]]),
        lambda: ms.PointCloud(points=[[1], [1, 2]], magnitude=[1.0]),
        lambda: ms.form_image(capture, box, oversampling="x"),
        lambda: ms.form_image(capture, box, oversampling=float("inf")),
        lambda: ms.form_image(capture, box, method=[]),
        lambda: ms.segment(image, prompts={}),
        lambda: ms.Radar.preset([]),
    ):
        with pytest.raises(MillisightError):
            make()


def test_what_is_divided_by_is_not_next_to_nothing():
    with pytest.raises(MillisightError, match=r"acceleration is 4.94066e-324 m/s²; expected at least 1e-300 m/s²"):
        World.from_table({"arm": {"acceleration": 5e-324}}, source="w")
    with pytest.raises(MillisightError, match=r"frame_period is 4.94066e-324 s; expected at least 1e-300 s"):
        World.from_table({"radars": [{"preset": "position2go", "frame_period": 5e-324}]}, source="w")
