"""The live page's server: what it tells, its pictures, and the button that ends the scan."""

import io
import json
import urllib.error
import urllib.request

import numpy as np
import pytest
from PIL import Image

from millisight.data import SarImage, VoxelGrid
from millisight.rig import LiveStatus
from millisight.viz.live import LivePage

GRID = VoxelGrid.regular((0, 0, -0.3), (0.1, 0.2, -0.2), (0.01, 0.02, 0.05))


def status(poses, *, at=(0, 0, 0), name="77_ghz"):
    values = np.full(GRID.shape, 1e-3, np.complex64)
    values[at] = 1
    image = SarImage(grid=GRID, values=values)
    return LiveStatus(radar=name, image=image, rows=poses // 10, poses=poses, lag=0.25, change=1 / poses)


@pytest.fixture
def page():
    with LivePage("mug in a carton", 12) as page:
        yield page


def get(page, path):
    with urllib.request.urlopen(page.address + path, timeout=10) as reply:
        return reply.read()


def about(page):
    return json.loads(get(page, "about"))


def test_it_tells_how_far_the_images_are(page):
    assert about(page) == {"title": "mug in a carton", "rows": 12, "state": "scanning", "told": "", "radars": []}
    page.show(status(10))
    page.show(status(20))
    (radar,) = about(page)["radars"]
    assert (radar["rows"], radar["poses"], radar["lag"], radar["changes"]) == (2, 20, 0.25, [0.1, 0.05])
    assert radar["views"][0] == {"axis": "z", "extent": pytest.approx([0, 0.1, 0, 0.2])}
    page.end("written to data")
    assert (about(page)["state"], about(page)["told"]) == ("over", "written to data")


@pytest.mark.parametrize(("axis", "size"), [("z", (11, 11)), ("y", (11, 3)), ("x", (11, 3))])
def test_pictures_have_the_second_axis_upwards(page, axis, size):
    page.show(status(10, at=(2, 1, 0)))
    picture = Image.open(io.BytesIO(get(page, f"picture/0/10/{axis}")))
    assert picture.size == size
    brightness = np.asarray(picture, int).sum(axis=2)
    row, column = np.unravel_index(brightness.argmax(), brightness.shape)
    right, up = {"z": (2, 1), "y": (2, 0), "x": (1, 0)}[axis]
    assert (column, size[1] - 1 - row) == (right, up)


def test_what_is_not_there_is_not_found(page):
    page.show(status(10))
    for path in ("picture/1/10/z", "picture/0/10/w", "picture/0", "else", "picture/a/b/c/d"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            get(page, path)


def test_the_button_ends_the_scan(page):
    assert not page.stop_asked
    with urllib.request.urlopen(page.address + "stop", data=b"{}", timeout=10) as reply:
        assert reply.status == 200
    assert page.stop_asked
    assert about(page)["state"] == "ending"
