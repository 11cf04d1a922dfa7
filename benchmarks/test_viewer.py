"""How long the viewer takes to open an image, and to answer a slider.

    make bench

Opening is a process from its start to a server that has the whole scene to hand out; the browser's own second or two
come on top.
"""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

import millisight as ms
from millisight.io.mito import published_grid
from millisight.viz.viewer import PaneGrid, first_settings, gather, start

GRIDS = {
    "published": published_grid("77_ghz", "tripod"),
    "twenty million": ms.VoxelGrid.regular((-0.1, -0.05, -0.37), (0.45, 0.55, -0.15), (0.001, 0.001, 0.0037)),
}
_OPEN = "import sys\nfrom millisight.viz.viewer import Viewer, gather\nwith Viewer(gather(sys.argv[1:])): pass"


def saved(path, grid, model, seed):
    """A bright ball in noise 40 dB under it."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((*grid.shape, 2), dtype=np.float32).view(np.complex64)[..., 0]
    x, y, z = grid.x[:, None, None], grid.y[:, None], grid.z
    ball = np.exp(-(((x - 0.2) / 0.05) ** 2) - ((y - 0.25) / 0.07) ** 2 - ((z + 0.26) / 0.03) ** 2)
    values = (0.01 * noise + ball * np.exp(1j * seed)).astype(np.complex64)
    ms.save(path, ms.SarImage(grid=grid, values=values, metadata={"history": [{"step": "simulate", "model": model}]}))
    return path


@pytest.fixture(scope="module", params=GRIDS)
def files(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("viewer")
    grid = GRIDS[request.param]
    return [saved(folder / f"{model}.h5", grid, model, i) for i, model in enumerate(("specular", "edge"))]


@pytest.mark.benchmark(group="open an image in the viewer")
def test_open(benchmark, files):
    command = [sys.executable, "-c", _OPEN, files[0]]
    benchmark.pedantic(subprocess.run, (command,), {"check": True}, rounds=3, warmup_rounds=1)
    print(f"\nopened in {benchmark.stats.stats.median:.2f} s")


CHANGES = {
    "threshold": ({"threshold_db": -30.0}, {}),
    "weights": ({"share": 0.8}, {}),
    "a slice": ({"slices": True, "points": False, "at": (0.1, 0.2, -0.2)}, {"slices": True, "points": False}),
}


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.benchmark(group="answer a control of the viewer")
def test_change(benchmark, files, name):
    """From a control's value to the scene's messages, there and back again."""
    found = gather(files)
    server = start()
    try:
        settings = first_settings(found)
        stage = PaneGrid(server, found, settings)
        there, back = (dataclasses.replace(settings, **change) for change in CHANGES[name])

        def there_and_back():
            stage.show(there)
            stage.show(back)

        benchmark.pedantic(there_and_back, rounds=5, warmup_rounds=1)
        assert len(found.exhibits) == 1
        print(f"\n{name}: {benchmark.stats.stats.median / 2 * 1e3:.0f} ms a change")
    finally:
        server.stop()
