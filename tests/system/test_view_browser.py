"""The viewer in a browser without a window: load, threshold, slice, compare, weigh, take a picture, share a page."""

import numpy as np
import pytest
from matplotlib.image import imread

import millisight as ms
from helpers import browser
from helpers.viewer_page import CAMERA, POINTS, POSITION, TURN, wait
from millisight.viz.viewer import Viewer, first_settings, gather, write_page
from millisight.viz.viewer._layout import placed

pytest.importorskip("viser", reason='needs viser: pip install "millisight[viewer]"')


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A specular and an edge image of one simulation, a square and a ring, and another image on their pixels."""
    folder = tmp_path_factory.mktemp("browser")
    grid = ms.VoxelGrid.regular((-0.05, -0.05, -0.02), (0.05, 0.05, 0.02), 0.01)
    x, y, z = np.meshgrid(grid.x, grid.y, grid.z, indexing="ij")
    square = (np.maximum(abs(x), abs(y)) < 0.025) & (abs(z) < 0.005)
    ring = (abs(np.hypot(x, y) - 0.04) < 0.006) & (abs(z) < 0.005)
    for name, shape, model in (("specular", square, "specular"), ("edge", ring, "edge"), ("other", square | ring, "")):
        history = [{"step": "simulate", "model": model}] if model else []
        values = np.where(shape, 1.0, 0.01 * np.exp(-abs(x) / 0.05)).astype(np.complex64)
        ms.save(folder / f"{name}.h5", ms.SarImage(grid=grid, values=values, metadata={"history": history}))
    return {name: folder / f"{name}.h5" for name in ("specular", "edge", "other")}, int(square.sum()), int(ring.sum())


@pytest.fixture(scope="module")
def driver():
    with browser.chromium(*browser.WEBGL, "--window-size=900,560") as driver:
        yield driver


@pytest.mark.slow
def test_the_viewer_draws_and_follows_its_controls(files, driver, tmp_path):
    paths, square, ring = files
    found = gather([paths["specular"], paths["edge"], paths["other"]])
    assert [e.title for e in found.exhibits] == ["specular, specular + edge", "other"]

    def points(pane="/pane0"):
        return driver.execute_script(POINTS, pane)

    with Viewer(found) as viewer:
        driver.get(viewer.url + "/?fixedDpr=1")  # on a busy machine viser would draw coarser as it goes
        # Load: half the voxels of each model are 6 dB down when both weigh the same.
        wait(lambda: points() == square + ring and points("/pane1") == square + ring)
        client = wait(lambda: next(iter(viewer.server.get_clients().values()), None))
        size = (240, 160)
        wait(lambda: "camera=" in driver.current_url)  # it has come to rest
        (first,) = wait(lambda: steady(client, size))
        assert first[..., 3].any()
        assert np.ptp(first[..., :3][first[..., 3] > 0], axis=0).max() > 50  # not blank, not of one colour

        # Weights: all edge leaves the ring, and a picture that is another.
        set_number(driver, "edge share", 1)
        wait(lambda: points() == ring)
        assert points("/pane1") == square + ring
        (second,) = wait(lambda: steady(client, size))
        changed = (first != second).any(axis=-1)
        half = size[0] // 2
        assert changed[:, :half].sum() > 20  # the left image
        assert changed[:, half:].sum() < changed[:, :half].sum() / 4  # and hardly the right one

        # Threshold: what is 40 dB down comes, too, and goes again.
        set_number(driver, "threshold [dB]", -60)
        wait(lambda: points() == points("/pane1") == 11 * 11 * 5)
        set_number(driver, "threshold [dB]", -3)
        wait(lambda: points() == ring)

        # Slices: planes come, and follow.
        assert driver.execute_script(POSITION, "/pane0/slice_z") is None
        check(driver, "slices")
        wait(lambda: driver.execute_script(POSITION, "/pane0/slice_z"))
        set_number(driver, "z [m]", -0.02)
        wait(lambda: abs(driver.execute_script(POSITION, "/pane0/slice_z")[2] + 0.02) < 1e-6)

        # Compare: the panes stay side by side across the line of sight when the camera turns.
        before = driver.execute_script(POSITION, "/pane1")
        driver.execute_script(TURN)
        wait(lambda: driver.execute_script(POSITION, "/pane1") != before)
        wait(lambda: side_by_side(driver, viewer.panes.radius))

        # Take away: both buttons give a file.
        allowed = {"behavior": "allow", "downloadPath": str(tmp_path)}
        driver.execute_cdp_cmd("Browser.setDownloadBehavior", allowed)
        buttons = {"Screenshot (PNG)": ("millisight.png", b"\x89PNG"), "Share (HTML)": ("millisight.html", b"<!doc")}
        for text, (name, start) in buttons.items():
            driver.find_element("xpath", f"//button[normalize-space(.)='{text}']").click()
            wait(lambda path=tmp_path / name: path.exists() and path.stat().st_size)
            assert (tmp_path / name).read_bytes().startswith(start)
        assert np.ptp(imread(tmp_path / "millisight.png")[..., 0]) > 0.5
        assert browser.complaints(driver) == []


def steady(client, size):
    """A picture that is the same as the one before, or none: labels come a moment after the points."""
    before, after = (client.get_render(size[1], size[0], transport_format="png", timeout=30) for _ in range(2))
    return [after] if np.array_equal(before, after) and (after[..., 3] > 0)[: size[1] // 6].any() else []


def side_by_side(driver, radius):
    """Whether the two panes are where the camera of this moment wants them."""
    camera = np.array(driver.execute_script(CAMERA))
    wanted = placed(2, radius, camera, np.array([0.0, 0.0, 1.0]))
    there = [driver.execute_script(POSITION, f"/pane{i}") for i in range(2)]
    return np.abs(np.array(there) - [place.position for place in wanted]).max() < 1e-3 * radius


def labelled(driver, label):
    """The row of the panel with that label."""
    return driver.find_element("xpath", f"//label[normalize-space(.)='{label}']/ancestor::*[.//input][1]")


def set_number(driver, label, value):
    """Type into a slider's field."""
    from selenium.webdriver.common.keys import Keys

    field = labelled(driver, label).find_elements("css selector", "input:not([type=hidden])")[-1]
    field.send_keys(Keys.CONTROL, "a")
    field.send_keys(str(value), Keys.ENTER)


def check(driver, label):
    labelled(driver, label).find_element("css selector", "input[type=checkbox]").click()


@pytest.mark.slow
def test_a_shared_page_opens_from_the_disk_without_network(files, driver, tmp_path):
    paths, square, ring = files
    found = gather([paths["specular"], paths["other"]])
    settings = first_settings(found, range_db=55.0)
    write_page(tmp_path / "page.html", found, settings)
    driver.get(f"file://{tmp_path}/page.html")

    def points(pane):
        return driver.execute_script(POINTS, pane)

    wait(lambda: (points("/pane0"), points("/pane1")) == (square, square + ring))
    assert driver.title == "specular, other \u2013 millisight"
    driver.execute_script("document.querySelector('#millisight .millisight-threshold').value = -55")
    wait(lambda: points("/pane0") == points("/pane1") == 11 * 11 * 5)
    driver.execute_script(TURN)
    wait(lambda: side_by_side(driver, found_radius(found)))
    asked = driver.execute_script("return performance.getEntriesByType('resource').map(e => e.name)")
    assert not [name for name in asked if not name.startswith(("data:", "blob:"))]


def found_radius(found):
    """As `PaneGrid` has it."""
    return 1.12 * max(np.linalg.norm(np.ptp(e.bounds, axis=0)) / 2 for e in found.exhibits)
