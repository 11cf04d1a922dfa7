"""The annotator as a person meets it: a real browser, real clicks, and the files that come of them."""

import json
import signal
import threading
import time
from contextlib import ExitStack

import numpy as np
import pytest
from PIL import Image

import millisight as ms
from helpers.annotating import Discs, radar_image
from helpers.annotator_page import Page
from helpers.browser import chromium, complaints, served
from millisight.data import Prompts
from millisight.viz.annotator import Annotation, AnnotatorServer, open_picture


@pytest.fixture(scope="module")
def driver():
    with chromium() as driver:
        yield driver


def photo(path):
    pixels = np.full((60, 80, 3), 160, np.uint8)
    Image.fromarray(pixels).save(path)
    return path


@pytest.fixture(params=["radar", "photo"])
def opened(request, driver, tmp_path):
    """An annotation with each kind of picture, and its page."""
    if request.param == "radar":
        path, suffix = tmp_path / "mug.image.h5", ".mask.h5"
        ms.save(path, radar_image())
    else:
        path, suffix = photo(tmp_path / "mug.png"), ".mask.png"
    segmenters = {"discs": Discs(), "sam": "no model"}
    annotation = Annotation(open_picture(path), tmp_path / f"mug{suffix}", segmenters=segmenters)
    with AnnotatorServer(annotation) as server:
        yield annotation, Page(driver, server.address)
        assert complaints(driver) == []
        driver.get("about:blank")


def test_points_are_added_removed_undone_redone_and_saved(opened):
    annotation, page = opened
    assert page.text("hint") == "Click on the object to begin"
    assert (page.text("mask"), page.mask_pixels) == ("no mask yet", 0)
    before = page.brightness([1, 1])

    page.click([6, 6])
    assert page.text("counts") == "1 on the object, 0 beside it"
    one = page.mask_pixels
    assert one == 29  # of a disc of three pixels
    assert page.text("hint") == ""
    if not annotation.subject.is_radar:
        assert page.brightness([1, 1]) < 0.7 * before  # what is outside is darker

    page.click([12, 6])
    two = page.mask_pixels
    assert two > one
    page.click([9, 6], right=True)
    three = page.mask_pixels
    assert three < two
    assert page.text("counts") == "2 on the object, 1 beside it"

    page.press("CONTROL", "z")
    assert (page.text("counts"), page.mask_pixels) == ("2 on the object, 0 beside it", two)
    page.driver.find_element("id", "undo").click()
    page.settled()
    assert page.mask_pixels == one
    page.press("CONTROL", "SHIFT", "z")
    page.driver.find_element("id", "redo").click()
    page.settled()
    assert page.mask_pixels == three
    assert not page.driver.find_element("id", "redo").is_enabled()

    page.click([12, 6])  # on a point: it goes
    assert page.text("counts") == "1 on the object, 1 beside it"
    assert page.driver.title.startswith("• ")

    page.press("CONTROL", "s")
    page.until("document.getElementById('save').textContent === 'Saved'")
    assert not page.driver.title.startswith("•")
    told = json.loads(annotation.prompts_path.read_text())
    np.testing.assert_array_equal(annotation.subject.on_screen(told["points"]), [[6, 6], [9, 6]])
    assert told["positive"] == [True, False]
    if annotation.subject.is_radar:
        inside = ms.load(annotation.mask_path).inside
    else:
        inside = np.asarray(Image.open(annotation.mask_path)) == 255
    shown = annotation.subject.shown(inside)
    assert shown.sum() == page.mask_pixels > 0
    assert shown[6, 5]
    assert not shown[6, 9]


def test_the_view_zooms_about_the_pointer_and_moves(opened):
    _, page = opened
    place = [14, 4]
    fitted, at = page.view, page.offset(place)
    page.wheel(place, -400)
    assert page.view[0] > 1.5 * fitted[0]
    assert np.abs(np.subtract(page.offset(place), at)).max() <= 1
    page.click(place)  # the pointer's place is right after zooming, too
    assert page.mask_pixels == 29

    zoomed = page.view
    page.hand(place).click_and_hold().move_by_offset(-60, 35).release().perform()
    page.settled()
    assert page.view == pytest.approx((zoomed[0], zoomed[1] - 60, zoomed[2] + 35))
    assert page.text("counts") == "1 on the object, 0 beside it"  # a drag is no click
    page.press("f")
    assert page.view == pytest.approx(fitted)
    page.click(place)
    assert page.text("counts") == "no points"


def test_the_newest_answer_wins_and_errors_are_shown(driver, tmp_path):
    clicked = threading.Event()

    class Slow(Discs):
        asked = 0

        def segment(self, picture, prompts):
            Slow.asked += 1
            clicked.wait(0 if len(prompts.points) > 1 else 20)
            if len(prompts.points) == 4:
                raise ms.errors.InputError("four points are <b>too many</b>")
            return super().segment(picture, prompts)

    subject = open_picture(photo(tmp_path / "a.png"))
    annotation = Annotation(subject, tmp_path / "a.mask.png", segmenters={"discs": Slow()})
    with AnnotatorServer(annotation) as server:
        page = Page(driver, server.address)
        page.hand([10, 10]).click().perform()
        time.sleep(0.1)  # it is being answered
        for column in (30, 50):
            page.hand([column, 10]).click().perform()
        clicked.set()
        page.settled()
        assert page.mask_pixels == 3 * 29
        assert Slow.asked == 2  # the one in between was not asked for
        page.click([50, 40])
        assert page.text("notice") == "four points are <b>too many</b>"
        assert page.mask_pixels == 0
        # A page with something unsaved is not left without a question.
        leaving = "const e = new Event('beforeunload', {cancelable: true}); dispatchEvent(e); return e.defaultPrevented"
        assert driver.execute_script(leaving)
        page.press("DELETE")
        assert page.text("counts") == "no points"
        assert not driver.execute_script(leaving)
    refused = complaints(driver)
    assert len(refused) == 1
    assert "422" in refused[0]
    driver.get("about:blank")


class Middle(Discs):
    """Finds the picture's middle without a prompt."""

    needs_prompts = False

    def segment(self, picture, prompts):
        if prompts is None:
            prompts = Prompts(points=[[n // 2 for n in picture.shape]], positive=[True])
        return super().segment(picture, prompts)


def test_colours_change_and_the_mask_does_not(driver, tmp_path):
    ms.save(tmp_path / "a.h5", radar_image())
    annotation = Annotation(open_picture(tmp_path / "a.h5"), tmp_path / "a.mask.h5", segmenters={"discs": Middle()})
    with AnnotatorServer(annotation) as server:
        page = Page(driver, server.address)
        assert page.mask_pixels == 29  # before the first click, and it can be saved
        assert page.driver.find_element("id", "save").is_enabled()
        page.click([6, 6])
        jet = page.brightness([22, 2]), page.mask_pixels
        page.press("c")
        page.until("document.querySelector('#colours input:checked').value === 'inferno'")
        page.frame()
        assert page.brightness([22, 2]) != jet[0]
        assert page.mask_pixels == jet[1]
        # Loaded anew, the page has the points still.
        annotation.save({"method": "discs", "points": [[6, 6]], "positive": [True]})
        page = Page(driver, server.address)
        assert page.text("counts") == "1 on the object, 0 beside it"
        server.ending.set()
        page.until("document.getElementById('notice').textContent.includes('has stopped')")
    driver.get("about:blank")


@pytest.fixture
def command(tmp_path):
    """Starts `millisight annotate` as a process of its own; gives it and the address that it prints."""
    with ExitStack() as stack:
        yield lambda *words, **settings: stack.enter_context(served("annotate", *words, cwd=tmp_path, **settings))


@pytest.mark.slow
def test_the_command_ends_with_its_page(driver, command, tmp_path):
    photo(tmp_path / "cup.png")
    process, address = command("cup.png", "--method", "classical", BROWSER="true")
    page = Page(driver, address)
    page.click([40, 30])
    page.click([5, 5], right=True)
    page.press("CONTROL", "s")
    page.until("document.getElementById('save').textContent === 'Saved'")
    driver.get("about:blank")
    out, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (0, "")
    assert out.splitlines()[-3:] == ["the page was closed", "wrote cup.mask.png", "wrote cup.prompts.json"]
    assert np.asarray(Image.open(tmp_path / "cup.mask.png")).shape == (60, 80)
    assert json.loads((tmp_path / "cup.prompts.json").read_text())["points"] == [[30, 40], [5, 5]]


@pytest.mark.slow
def test_ctrl_c_ends_it_and_says_what_was_not_saved(driver, command, tmp_path):
    ms.save(tmp_path / "mug.image.h5", radar_image())
    process, address = command("mug.image.h5", "--method", "classical", "--no-browser")
    page = Page(driver, address)
    page.click([6, 6])
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0
    assert out.splitlines()[-1] == "ended"
    assert err == "millisight: the last points were not saved\n"
    assert [path.name for path in tmp_path.iterdir()] == ["mug.image.h5"]


@pytest.mark.slow
def test_more_tabs_than_a_browser_has_connections(driver, tmp_path):
    """Each held one of six; with six tabs none could ask or save any more."""
    ms.save(tmp_path / "mug.image.h5", radar_image())
    annotation = Annotation(
        open_picture(tmp_path / "mug.image.h5"), tmp_path / "mug.mask.h5", segmenters={"discs": Discs()}
    )
    first = driver.current_window_handle
    with AnnotatorServer(annotation) as server:
        for _ in range(7):
            driver.switch_to.new_window("tab")
            page = Page(driver, server.address)
        tabs = [tab for tab in driver.window_handles if tab != first]
        page.click([5, 5])
        driver.find_element("id", "save").click()
        page.until("document.getElementById('saved').textContent !== ''")
        assert annotation.saved_now
        # The tab that holds the connection is closed: another one takes over, and the server is not left.
        driver.switch_to.window(tabs[0])
        driver.close()
        driver.switch_to.window(tabs[-1])
        end = time.monotonic() + 5
        while server._pages != 1:
            assert time.monotonic() < end
            time.sleep(0.02)
    page.until("document.body.innerText.includes('millisight has stopped')")
    for tab in tabs[1:]:
        driver.switch_to.window(tab)
        page.until("document.body.innerText.includes('millisight has stopped')")
        driver.close()
    driver.switch_to.window(first)
