"""The first hour of a newcomer: the README from top to bottom, a mesh and a scan of one's own, a carton, and nonsense.

Everything is typed as printed, in fresh folders, and judged by what its pictures show. The pages are in a browser.
"""

import json
import os
import re
import shutil

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy import ndimage

import millisight as ms
from helpers import browser, pictures
from helpers.annotator_page import Page
from helpers.commands import run, run_here
from helpers.printed import (
    README,
    commands_in,
    locate_roughly,
    why_not,
    words_of,
    write_recording,
    write_scan,
    write_scenes,
)
from helpers.small_hub import Hub
from helpers.viewer_page import CAMERA, POINTS, POSITION, TURN, wait
from millisight.cli.demo_carton import look_into_carton
from millisight.viz import save_figure

DOWNLOADED = r"^millisight dataset download"
QUICKER = {"simulate": {"vertices": 5000}, "evaluate": {"segmentation": {"seeds": 1}}}
"""Defaults of options that the README leaves out, for less time than a reader's."""


def typed(line, defaults=None):
    """What a command prints, typed in the folder of now; it must do what it promises."""
    code, out, err, error = run_here(*words_of(line), defaults=defaults)
    assert (code, error) == (0, ""), f"{line}\n{out}{err}{error}"
    return out


def contrast(shown, inside, beside):
    """How much brighter the pixels `inside` are than those `beside`, by their medians."""
    assert inside.sum() > 10
    assert beside.sum() > 10
    return np.median(shown[inside]) / max(np.median(shown[beside]), 1.0)


def silhouette(mesh, grid_xy, middle=(0.0, 0.0)):
    """(X, Y) bool: pixels that a mesh covers, seen along z."""
    spacing = grid_xy.x[1] - grid_xy.x[0]
    places = trimesh.sample.sample_surface(trimesh.Trimesh(mesh.vertices, mesh.faces), 60_000, seed=0)[0][:, :2]
    i, j = np.round((places + middle - [grid_xy.x[0], grid_xy.y[0]]) / spacing).astype(int).T
    covered = np.zeros(grid_xy.shape, dtype=bool)
    covered[i, j] = True
    return covered


# The README.


@pytest.mark.first
def test_the_readme_from_top_to_bottom(tmp_path, miniature, monkeypatch):
    pytest.importorskip("onnxruntime", reason='needs onnxruntime: pip install "millisight[perception]"')
    pytest.importorskip("huggingface_hub", reason='needs huggingface_hub: pip install "millisight[hub]"')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0}, raising=False)  # one process: no others to be started
    write_recording("adc_data.bin")
    write_scan(tmp_path / "raw", tmp_path / "my_scan.toml")
    write_scenes(tmp_path / "DATASET")
    blocks = re.findall(
        r"^(```(python|sh)\n(.*?)^```)", README.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    hub_files = {
        path.relative_to(miniature.healthy).as_posix(): path.read_bytes()
        for path in miniature.healthy.rglob("*")
        if path.is_file() and "exp2" not in path.parts
    }
    # How well they find a pose, images of finer meshes, and listings of many pages are tried elsewhere.
    locate_roughly(monkeypatch)
    monkeypatch.setattr("helpers.small_hub.PAGE", 100)
    monkeypatch.setitem(ms.Scene.from_mesh.__kwdefaults__, "vertices", 1000)
    told, ran = {}, 0
    with Hub(hub_files) as hub:
        monkeypatch.setenv("HF_ENDPOINT", hub.endpoint)
        for whole, kind, inner in blocks:
            if kind == "python":
                exec(compile(inner, "README.md", "exec"), {"__name__": "readme"})
                ran += 1
                continue
            for line in commands_in(whole):
                if why_not(line) and not re.match(DOWNLOADED, line):
                    continue
                with monkeypatch.context() as patch:
                    if line.startswith("millisight evaluate"):  # its pictures are not looked at
                        patch.setitem(save_figure.__kwdefaults__, "dpi", 40)
                    told[line.split("#")[0].strip()] = typed(line, QUICKER)
    assert ran == 2
    assert len(told) > 12

    # The mug: its bottom, its rim and its handle are where the mesh has them.
    image = ms.load("mug.image.h5", ms.SarImage)
    shown = pictures.on_grid(pictures.panels("mug.png")[0], image.grid.xy)
    x, y = np.meshgrid(image.grid.x, image.grid.y, indexing="ij")
    middle = -0.0125  # of the cup; the handle is on the right
    away = np.hypot(x - middle, y)
    assert contrast(shown, away < 0.035, away > 0.065) > 5
    handle, opposite = (abs(y) < 0.006) & (abs(x - 0.05) < 0.008), (abs(y) < 0.006) & (abs(x + 0.075) < 0.003)
    assert contrast(shown, handle, opposite) > 2
    assert len(pictures.panels("slices.png")) >= 3
    inside = ms.load("mug.mask.h5", ms.Mask).inside
    assert inside[away < 0.03].mean() > 0.9
    assert inside[away > 0.07].mean() < 0.2
    named = re.match(r"mug: (.*?) \(mask", told["millisight classify mug.image.h5"])[1]
    assert named.startswith(("cup", "not sure: cup"))

    # The scan: a point in the middle.
    (scanned, *_) = pictures.panels("scan.png")
    bright = pictures.brightness(scanned)
    at = np.argwhere(bright > 0.9 * bright.max()).mean(axis=0) / bright.shape
    np.testing.assert_allclose(at, 0.5, atol=0.05)
    # The dataset: a picture of each image.
    drawn = list((tmp_path / "images").rglob("*.png"))
    assert len(drawn) >= 4
    assert all(np.ptp(pictures.brightness(pictures.panels(path)[0])) > 100 for path in drawn)


# A mesh of one's own.


@pytest.fixture(scope="module")
def bracket(tmp_path_factory):
    """A folder with an angle of sheet metal, in millimetres, and what the README's commands make of it."""
    folder = tmp_path_factory.mktemp("bracket")
    arms = [trimesh.creation.box(bounds=b) for b in ([[-40, -40, 0], [40, -15, 6]], [[-40, -20, 0], [-15, 40, 6]])]
    for suffix in ("stl", "ply"):  # the second is what the README shows beside an image
        arms[0].union(arms[1], engine="manifold").export(folder / f"bracket.{suffix}")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        _, _, _, asked = run_here("simulate", "bracket.stl")
        assert asked.startswith("bracket.stl is 80 m wide when read in metres; did you mean millimetres")
        typed("millisight simulate bracket.stl --unit mm --aperture 16x16cm --step 2mm -o bracket.capture.h5")
        typed("millisight image bracket.capture.h5 --grid 2mm --plot bracket.png")
    return folder


def arms_of(x, y):
    """Pixels well within the angle, and in its notch."""
    upright = (abs(x + 0.0275) < 0.006) & (abs(y) < 0.03)
    lying = (abs(y + 0.0275) < 0.006) & (abs(x) < 0.03)
    return upright, lying, (x > 0) & (y > 0)


@pytest.mark.slow
def test_a_mesh_of_ones_own_is_seen_in_its_shape(bracket):
    image = ms.load(bracket / "bracket.image.h5", ms.SarImage)
    above, *others = pictures.panels(bracket / "bracket.png")
    assert len(others) == 2
    shown = pictures.on_grid(above, image.grid.xy)
    upright, lying, notch = arms_of(*np.meshgrid(image.grid.x, image.grid.y, indexing="ij"))
    assert min(contrast(shown, upright, notch), contrast(shown, lying, notch)) > 5


# A shut carton.


def test_scissors_in_a_shut_carton_are_seen_and_named(tmp_path, monkeypatch):
    pytest.importorskip("onnxruntime", reason='needs onnxruntime: pip install "millisight[perception]"')
    monkeypatch.chdir(tmp_path)
    facts = look_into_carton(tmp_path).facts
    assert "handle" in facts["class"]
    opened, shut, through = pictures.panels("carton.png")
    for panel in (opened, shut, through):
        assert np.ptp(pictures.brightness(panel)) > 100
    # The camera sees scissors in the middle, and cardboard there once the box is shut.
    middle = tuple(slice(int(0.3 * n), int(0.7 * n)) for n in opened.shape[:2])
    assert pictures.brightness(opened)[middle].std() > 2 * pictures.brightness(shut)[middle].std()

    # The radar sees them through the lid, where the world has them.
    image = ms.load("carton-77ghz.image.h5", ms.SarImage)
    scissors = silhouette(ms.Scene.from_mesh("scissors", rotate_deg=(0, 0, 90)).mesh, image.grid.xy, (0.12, 0.17))
    far = ~ndimage.binary_dilation(scissors, iterations=10)
    assert contrast(pictures.on_grid(through, image.grid.xy), scissors, far) > 2
    inside = ms.load("carton.mask.h5", ms.Mask).inside
    assert (inside & ndimage.binary_dilation(scissors, iterations=2)).sum() > 0.8 * inside.sum()
    assert (inside & scissors).sum() > 0.3 * scissors.sum()

    # From its raw frames, as the demo tells to try next.
    typed("millisight image shut_carton/77_ghz.toml --clutter lid --plot scissors.png")
    shown = pictures.on_grid(pictures.panels("scissors.png")[0], ms.load("shut_carton/77_ghz.image.h5").grid.xy)
    blade = ndimage.binary_erosion(scissors, iterations=2) & (image.grid.y < 0.15)
    assert contrast(shown, blade, far) > 5
    typed("millisight segment carton-77ghz.image.h5 --condition nlos")
    alone = ms.load("carton-77ghz.mask.h5", ms.Mask).inside
    assert (alone & ndimage.binary_dilation(scissors, iterations=3)).sum() > 0.8 * alone.sum() > 0


# Nonsense.

NONSENSE = {
    "simulate broken.stl": "broken.stl gives 0 faces; expected a surface in STL format",
    "simulate empty.stl": "empty.stl gives 0 faces",
    "simulate folder": "folder is a folder; expected a mesh file",
    "simulate missing.stl": "missing.stl does not exist; expected a mesh file",
    "simulate notes.txt": r"unknown mesh format 'txt'. Known: .*stl",
    "simulate muug": "unknown catalogue object 'muug'. Did you mean 'mug'?",
    "simulate mug --step 2": r"--step is 2 without a unit; which is meant: 2mm, 2cm or 2m\?",
    "simulate mug --step=-2mm": "step is -0.002 m; expected more than 0 m",
    "simulate mug --aperture 30cm": "--aperture is '30cm'; expected a size along x and y such as 30x22cm",
    "simulate mug --radar iwr1444": "unknown radar 'iwr1444'. Did you mean 'iwr1443'?",
    "simulate mug -o mug.png": "unknown format of mug.png",
    "simulate mug -o nowhere/mug.h5": "there is no folder nowhere; make it or choose another",
    "image words.capture.h5": "is not an HDF5 file .*; expected one that millisight wrote",
    "image empty.h5": "empty.h5 is empty; expected an HDF5 file that millisight wrote",
    "image cut.h5": "cut.h5 is cut short: .*; make or copy it again",
    "image folder": "folder holds no capture: .*; pass a file",
    "image broken.stl": "broken.stl is a mesh; `millisight simulate` makes a capture of it",
    "info notes.txt": "notes.txt line 1 has 1 cells; expected",
    "segment missing.h5": "missing.h5: no such file",
    "classify folder": r"folder holds no image: .*make some with `millisight image`",
    "view notes.txt --no-browser": "notes.txt cannot be shown .*; expected an image",
    "annotate notes.txt --no-browser": "notes.txt is not an HDF5 file",
    "evaluate segmentation folder": "folder holds no object of the published layout; expected folders such as",
    "dataset list folder": "folder holds no object of the published layout",
    "collect notes.txt -o out": "notes.txt is not valid TOML: .*line 1",
    "simulate": "Missing argument 'mesh'",
    "simulate mug --stepp 2mm": "No such option: --stepp",
    "fly": "No such command 'fly'",
}


@pytest.mark.slow
def test_nonsense_is_answered_in_one_clear_message(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("broken.stl", "notes.txt", "words.capture.h5"):
        (tmp_path / name).write_text("this is none\n", encoding="utf-8")
    for name in ("empty.stl", "empty.h5"):
        (tmp_path / name).touch()
    ms.save("whole.h5", ms.SarImage(grid=ms.VoxelGrid.regular((0, 0, 0), (1, 1, 1), 0.5), values=np.ones((3, 3, 3))))
    (tmp_path / "cut.h5").write_bytes((tmp_path / "whole.h5").read_bytes()[:3000])
    (tmp_path / "folder").mkdir()
    before = sorted(tmp_path.rglob("*"))
    for words, expected in NONSENSE.items():
        code, _, err, error = run_here(*words.split())  # any other error than one with a message is raised
        assert code == (2 if err.startswith("Usage: ") else 1), words
        told = error or err
        assert re.search(expected, " ".join(told.split())), f"{words}: {told}"
        assert told.count("\n") <= (4 if code == 2 else 1), told
    assert sorted(tmp_path.rglob("*")) == before
    # Printed by the program itself, in a process of its own.
    code, out, err = run("simulate", "mug", "--step", "2", cwd=tmp_path)
    assert (code, out) == (1, "")
    assert err == "millisight: --step is 2 without a unit; which is meant: 2mm, 2cm or 2m?\n"


# The pages.


@pytest.fixture(scope="module")
def driver():
    with browser.chromium(*browser.WEBGL, "--window-size=1000,700") as driver:
        yield driver


def printed(command, **names):
    """The README's line with that command, other names put in."""
    (line,) = [line for line in commands_in(README.read_text(encoding="utf-8")) if re.match(command, line)]
    for name, other in names.items():
        line = line.replace(name, other)
    return words_of(line)


HIDE_NOTICES = "document.querySelectorAll('.mantine-Notifications-root').forEach(e => { e.style.display = 'none' })"


def lit(driver, folder):
    """(rows, columns) bool: colourful pixels of the page, its panel, text and notices left out."""
    driver.execute_script(HIDE_NOTICES)
    driver.save_screenshot(str(folder / "page.png"))
    shown = np.asarray(Image.open(folder / "page.png").convert("RGB")).astype(int)[60:-60, :600]
    return np.ptp(shown, axis=-1) > 60


@pytest.mark.first
@pytest.mark.slow
def test_the_viewer_shows_the_shape_turns_cuts_slices_and_tells_values(bracket, driver, tmp_path):
    from selenium.webdriver.common.action_chains import ActionChains

    pytest.importorskip("viser", reason='needs viser: pip install "millisight[viewer]"')
    words = [*printed("millisight view ", mug="bracket"), "--no-browser"]

    def press(*keys):
        driver.find_element("css selector", "body").send_keys(*keys)

    def shape():
        """Shares of the four quarters of what is lit, [upper, lower][left, right]."""
        seen = lit(driver, tmp_path)
        rows, columns = np.nonzero(ndimage.binary_opening(seen))
        if len(rows) < 500:
            return None
        box = seen[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        up, left = box.shape[0] // 2, box.shape[1] // 2
        return [[part[:, :left].mean(), part[:, left:].mean()] for part in (box[:up], box[up:])]

    with browser.served(*words, cwd=bracket) as (_, address):
        driver.get(address + "/?fixedDpr=1")
        wait(lambda: driver.execute_script(POINTS, "/pane0"))
        wait(lambda: "camera=" in driver.current_url)
        assert driver.title.startswith("bracket")
        press("b")  # without the box
        press("t")
        wait(lambda: abs(np.array(driver.execute_script(CAMERA))[:2]).max() < 0.02)
        upper, lower = wait(shape)
        assert upper[1] < 0.25 * min(upper[0], *lower)  # the notch

        # The value under the pointer, on the arm that lies and in the notch.
        canvas = wait(lambda: driver.execute_script("return window.__viserMutable.canvas"))

        def told(x, y):
            ActionChains(driver).move_to_element_with_offset(canvas, x, y).perform()
            return driver.execute_script("return document.querySelector('#millisight-foot').textContent")

        text = wait(lambda: told(-30, 60) or told(-60, 60) or told(-90, 90))
        assert " dB, |I| " in text
        x, y = (float(v.replace("\u2212", "-").split()[-1]) for v in text.split(" cm:")[0].split(",")[:2])
        assert -4.5 < x < 4.5
        assert -4.5 < y < 0
        wait(lambda: told(80, -80) == "")

        # Turn, slice, cut.
        before = lit(driver, tmp_path)
        driver.execute_script(TURN)
        wait(lambda: (lit(driver, tmp_path) ^ before).sum() > 0.1 * before.sum())
        press("2")
        wait(lambda: driver.execute_script(POSITION, "/pane0/slice_z"))
        press("2")
        many = wait(lambda: driver.execute_script(POINTS, "/pane0"))
        press(*"[" * 8)
        wait(lambda: 0 < (driver.execute_script(POINTS, "/pane0") or 0) < many)
        assert browser.complaints(driver) == []
        driver.get("about:blank")


@pytest.mark.slow
def test_the_annotator_marks_the_object_where_it_is_clicked(bracket, driver, tmp_path):
    pytest.importorskip("onnxruntime", reason='needs onnxruntime: pip install "millisight[perception]"')
    shutil.copy(bracket / "bracket.image.h5", tmp_path)
    image = ms.load(tmp_path / "bracket.image.h5", ms.SarImage)
    upright, lying, notch = arms_of(*np.meshgrid(image.grid.x, image.grid.y, indexing="ij"))
    words = [*printed("millisight annotate ", mug="bracket"), "--method", "classical"]
    with browser.served(*words, cwd=tmp_path, BROWSER="true") as (process, address):
        browser.complaints(driver)  # of the pages before
        page = Page(driver, address)
        count = len(image.grid.y) - 1

        def place(x, y):
            """Column and row on the picture, y up."""
            return [int(abs(image.grid.x - x).argmin()), count - int(abs(image.grid.y - y).argmin())]

        page.press("c")  # colours whose brightness is the value
        page.until("document.querySelector('#colours input:checked').value === 'inferno'")
        page.frame()
        assert page.brightness(place(-0.0275, -0.0275)) > 2 * page.brightness(place(0.03, 0.03))
        page.click(place(-0.0275, 0.02))
        page.click(place(0.02, -0.0275))
        page.click(place(0.03, 0.03), right=True)
        page.press("CONTROL", "s")
        page.until("document.getElementById('save').textContent === 'Saved'")
        assert browser.complaints(driver) == []
        driver.get("about:blank")
        process.communicate(timeout=30)
        assert process.returncode == 0
    inside = ms.load(tmp_path / "bracket.mask.h5", ms.Mask).inside
    assert min(inside[upright].mean(), inside[lying].mean()) > 0.9
    assert inside[notch].mean() < 0.1
    assert len(json.loads((tmp_path / "bracket.prompts.json").read_text())["points"]) == 3
