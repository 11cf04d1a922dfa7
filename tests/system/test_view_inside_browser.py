"""The viewer opens a carton on its object, in a browser without a window: by what its pixels show."""

import numpy as np
import pytest

import millisight as ms
from helpers import browser
from helpers.lids import covered_image
from helpers.viewer_page import CAMERA, POINTS, TURN, wait
from millisight.viz.viewer import Viewer, first_settings, gather, write_page

pytest.importorskip("viser", reason='needs viser: pip install "millisight[viewer]"')

_SIZE = (240, 160)
_NOTE = "return document.querySelector('#millisight-head span').textContent"


@pytest.fixture(scope="module")
def carton(tmp_path_factory):
    """A file with an image of a spot under a lid."""
    path = tmp_path_factory.mktemp("inside") / "carton.image.h5"
    ms.save(path, covered_image())
    return path


@pytest.fixture(scope="module")
def driver():
    with browser.chromium(*browser.WEBGL, "--window-size=1000,640") as driver:
        yield driver


def opened(driver, viewer):
    """The browser's handle, once its page has the scene and our script."""
    driver.get("about:blank")
    browser.complaints(driver)  # of viewers that were closed before
    driver.get(viewer.url)
    wait(lambda: driver.execute_script(POINTS, "/pane0"))
    wait(lambda: "millisight" in driver.title)
    wait(lambda: "camera=" in driver.current_url)  # it has come to rest
    # The last one: the page of a viewer that was closed may have found this one, at the same port.
    return wait(lambda: [*viewer.server.get_clients().values()])[-1]


def drawn(client):
    """(rows, columns) bool: which pixels of the scene are not empty."""
    return client.get_render(_SIZE[1], _SIZE[0], transport_format="png", timeout=30)[..., 3] > 0


def press(driver, *keys):
    driver.find_element("css selector", "body").send_keys(*keys)


def test_a_carton_opens_on_its_object_and_shows_its_lid_when_asked(carton, driver):
    found = gather([carton])
    with Viewer(found, first_settings(found, box=False)) as viewer:
        client = opened(driver, viewer)
        assert driver.title == "carton \u2013 millisight"
        assert driver.find_element("css selector", "#millisight-head h1").text == "carton"
        wait(lambda: driver.execute_script(_NOTE).startswith("There is a lid at z = 3.0 cm, its echo taken off."))
        spot = drawn(client)
        rows, columns = np.nonzero(spot)
        assert 20 < len(rows) < 0.1 * spot.size
        assert np.ptp(columns) < _SIZE[0] / 3  # the spot, and not the lid

        # The button beside the note brings the lid, and the button that takes its place takes it away again.
        driver.find_element("css selector", "#millisight-head button").click()
        wait(lambda: not viewer.settings.clipped and viewer.painted is viewer.settings)
        wait(lambda: drawn(client).sum() > 6 * spot.sum())
        whole = drawn(client)
        assert "Look under the lid" in driver.find_element("css selector", "#millisight-head button").text

        # A limit takes away what lies behind it, and nothing else.
        viewer.change(clip_x=(0.0, np.inf))
        wait(lambda: drawn(client).sum() < 0.7 * whole.sum())
        half = drawn(client)
        assert (half & ~whole).sum() < 0.02 * whole.sum()
        assert np.nonzero(half)[1].mean() > np.nonzero(whole)[1].mean() + 0.05 * _SIZE[0]
        assert driver.execute_script(_NOTE).endswith("Shown: x over 0.0 cm.")

        driver.find_element("css selector", "body").send_keys("l")
        wait(lambda: viewer.settings.clipped and not viewer.settings.clutter)
        driver.find_element("css selector", "body").send_keys("0")
        wait(lambda: not viewer.settings.clipped)
        assert browser.complaints(driver) == []


def test_a_reload_and_a_copied_address_show_the_same(carton, driver):
    found = gather([carton])
    settings = first_settings(found, box=False)

    def kept():
        return viewer.settings.threshold_db, viewer.settings.slices, round(viewer.settings.clip_z[1], 6)

    with Viewer(found, settings) as viewer:
        opened(driver, viewer)
        start = driver.current_url
        press(driver, "2", "-", "-", "[")
        driver.execute_script(TURN)
        wait(lambda: viewer.settings.slices and viewer.settings.threshold_db == -17)
        wait(lambda: "slices=1" in driver.current_url and driver.current_url.split("camera=")[1] not in start)
        camera = wait(lambda: settled(driver))
        before, address = kept(), driver.current_url
        viewer.change(slices=False, threshold_db=-3.0)  # elsewhere, while the page is away
        driver.get("about:blank")
        driver.get(address)
        wait(lambda: kept() == before)
        wait(lambda: np.allclose(driver.execute_script(CAMERA), camera, rtol=1e-3, atol=1e-3))
        driver.get("about:blank")  # before its server ends

    # The same address, of a viewer that has just been started.
    with Viewer(found, settings) as viewer:
        assert kept() != before
        driver.get(viewer.url + "/?" + address.split("?")[1])
        wait(lambda: kept() == before)
        wait(lambda: np.allclose(driver.execute_script(CAMERA), camera, rtol=1e-3, atol=1e-3))
        # An address of something else counts nothing.
        driver.get("about:blank")
        driver.get(viewer.url + "/?threshold_db=-1&of=other&camera=9,9,9,0,0,0")
        wait(lambda: "of=other" not in driver.current_url)
        assert kept() == before
        assert browser.complaints(driver) == []


def settled(driver):
    """The camera's place, once it has come to rest and the address tells it."""
    first = driver.current_url
    camera = driver.execute_script(CAMERA)
    told = [float(v) for v in first.split("camera=")[1].split(",")[:3]]
    return camera if np.allclose(told, camera, rtol=1e-3, atol=1e-3) else None


def test_value_and_place_are_told_under_the_pointer_and_keys_are_listed(carton, driver):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    found = gather([carton])
    with Viewer(found, first_settings(found)) as viewer:
        client = opened(driver, viewer)
        viewer.look_from(client, "above")
        wait(lambda: abs(np.array(driver.execute_script(CAMERA))[:2]).max() < 0.02)
        canvas = wait(lambda: driver.execute_script("return window.__viserMutable.canvas"))
        foot = "return document.querySelector('#millisight-foot').textContent"

        def told(x):
            ActionChains(driver).move_to_element_with_offset(canvas, x, 0).perform()
            return driver.execute_script(foot)

        text = wait(lambda: told(1) or told(-1))  # over the middle: the spot
        assert text.startswith("x ")
        assert " dB, |I| " in text
        place = [float(v.replace("\u2212", "-").split()[-1]) for v in text.split(" cm:")[0].split(",")]
        assert np.abs(place[:2]).max() < 1.5
        assert place[2] < 100 * viewer.settings.clip_z[1]
        wait(lambda: told(-200) == "")  # beside it

        press(driver, "?")
        shown = driver.find_element("css selector", "#millisight-help")
        assert "look from above" in wait(lambda: shown.text)
        press(driver, Keys.ESCAPE)
        wait(lambda: not shown.is_displayed())
        assert browser.complaints(driver) == []


@pytest.mark.slow
def test_a_shared_page_opens_under_the_lid(carton, driver, tmp_path):
    found = gather([carton])
    settings = first_settings(found, box=False)
    write_page(tmp_path / "carton.html", found, settings)
    driver.get("about:blank")
    browser.complaints(driver)  # of viewers that were closed before
    driver.get(f"file://{tmp_path}/carton.html")
    cover = found.exhibits[0].cover
    inside = len(cover.levels.strongest(settings.threshold_db, 10**6, settings.limits).db)
    whole = len(found.exhibits[0].levels.strongest(settings.threshold_db, 10**6).db)
    assert 0 < 6 * inside < whole

    def points():
        return driver.execute_script(POINTS, "/pane0") or 0, driver.execute_script(
            POINTS.replace("/points", "/covered"), "/pane0"
        )

    wait(lambda: points() == (inside, 0))
    assert "There is a lid at z = 3.0 cm" in driver.execute_script(_NOTE)
    driver.find_element("css selector", "#millisight-head button").click()
    wait(lambda: points() == (0, whole))
    press(driver, "l")
    wait(lambda: points() == (inside, 0))
    press(driver, "-", "-")
    lower = len(cover.levels.strongest(settings.threshold_db - 2, 10**6, settings.limits).db)
    wait(lambda: points() == (lower, 0))
    wait(lambda: "threshold=-17" in driver.current_url)
    driver.refresh()
    wait(lambda: points() == (lower, 0))
    assert browser.complaints(driver) == []
