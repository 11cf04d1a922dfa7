"""Scenes behind plane layers, against paths by Fermat's principle that are worked out here."""

from dataclasses import replace

import numpy as np
import pytest

import millisight as ms
from helpers.oracles import C, relative, snell
from millisight.calibration import see_through, set_medium, set_one_way
from millisight.core import phase

POINT = np.array([[0.02, -0.03, -0.05]])
LAYERS = [(0.15, 2.6), (0.1, 1.0), (0.05, 6.0)]
WAVEFORM = ms.Waveform.stepped(24e9, 100e6, 32)


def seen(count, step, height=0.4, towards=(0, 0, -1)):
    """The capture of one reflector behind the layers, from a raster of count x count poses, TX and RX apart."""
    line = step * (np.arange(count) - (count - 1) / 2)
    places = np.array([[x, y, height] for x in line for y in line])
    tx, rx = np.add(places, (-0.02, 0, 0)), np.add(places, (0, 0.02, 0.01))
    d = snell(POINT, tx, LAYERS, 1.0) + snell(POINT, rx, LAYERS, 1.0) + 0.1
    frames = np.exp(-2j * np.pi * d * WAVEFORM.frequencies / C)[:, None, None]
    turn = np.eye(3)
    if towards[0]:  # the same set-up, seen along x: world (x, y, z) -> (z, y, x)
        turn = turn[:, ::-1]
    array = ms.AntennaArray(
        tx_positions=np.array([[-0.02, 0, 0]]) @ turn.T, rx_positions=np.array([[0, 0.02, 0.01]]) @ turn.T
    )
    capture = ms.Capture(
        radar=ms.Radar(name="r", waveform=WAVEFORM, array=array, path_offset=0.1),
        trajectory=ms.Trajectory(times=np.arange(len(places)), positions=places @ turn.T),
        frames=frames.astype(np.complex64),
    )
    return capture, turn


def around(turn, spacing):
    low, high = (turn @ (POINT[0] + reach) for reach in (-np.array([0.03, 0.03, 0.02]), np.array([0.03, 0.03, 0.02])))
    return ms.VoxelGrid.regular(low, high, spacing)


@pytest.mark.parametrize("behind", [0.0, 0.2])
def test_paths_are_snells_also_where_no_air_lies_behind(behind):
    """From the angle to where the ray comes out: n sin is the same in every layer, and n t / cos adds up."""
    rng = np.random.default_rng(0)
    for sine in np.linspace(0, 0.75, 7):  # times the index
        thicknesses, indices = rng.uniform(0.01, 0.1, 3), rng.uniform(1.2, 2.5, 3)
        t, n = np.append(thicknesses, behind), np.append(indices, 1.0)
        cosines = np.sqrt(1 - (sine / n) ** 2)
        across, path = (t * sine / n / cosines).sum(), (n * t / cosines).sum()
        assert phase.refracted(across, t.sum(), thicknesses, indices) == pytest.approx(path, rel=1e-12)


@pytest.mark.parametrize(
    ("method", "towards"), [("exact", (0, 0, -1)), ("backprojection", (-1, 0, 0)), ("fast", (0, 0, -1))]
)
def test_a_reflector_behind_layers_is_one_at_its_place(method, towards):
    capture, turn = seen(20, 0.05, towards=towards)
    grid = around(turn, 0.005)
    through = see_through(capture, LAYERS, towards=towards)
    image = ms.form_image(through, grid, method=method)
    assert np.abs(image.peak - turn @ POINT[0]).max() < 1e-9
    assert image.magnitude.max() == pytest.approx(1, abs=1e-5 if method == "exact" else 0.005)
    # Straight rays from moved antennas alone, which fit best, are far off here.
    straight = ms.form_image(replace(through, layers=None), grid, method="exact")
    assert straight.magnitude.max() < 0.6


@pytest.mark.slow
def test_factorised_backprojection_bends_paths_too():
    through = see_through(seen(80, 0.007)[0], LAYERS)
    grid = ms.VoxelGrid.regular(POINT[0] - [0.15, 0.15, 0], POINT[0] + [0.15, 0.15, 0], 0.0015)
    image = ms.form_image(through, grid)
    told = image.metadata["history"][-1]
    assert told["done_by"] == "factorised backprojection"
    assert image.magnitude.max() == pytest.approx(1, abs=0.005)
    assert np.abs(image.peak - POINT[0]).max() < 1e-9
    some = np.random.default_rng(0).integers(0, grid.size, 200)
    points = np.concatenate([grid.points[some], POINT])
    exact = ms.image_at(
        through.frames, through.tx_positions, through.rx_positions, WAVEFORM.frequencies, points,
        through.radar.path_offset, layers=through.layers,
    )  # fmt: skip
    assert relative(image.values.ravel()[some], exact[:-1]) < 0.02
    assert abs(exact[-1]) == pytest.approx(1, abs=1e-5)


def test_layers_are_kept_on_disk_and_by_what_follows(tmp_path):
    through = see_through(seen(6, 0.05)[0], LAYERS)
    ms.save(tmp_path / "c.h5", through)
    with ms.open_capture(tmp_path / "c.h5") as opened:
        assert np.array_equal(opened.layers.indices, through.layers.indices)
        assert opened.layers.moved == through.layers.moved
        grid = around(np.eye(3), 0.01)
        assert np.array_equal(ms.form_image(opened, grid).values, ms.form_image(through, grid).values)
    assert ms.calibration.subtract_mean(through).layers is through.layers
    log = ms.Trajectory(times=through.trajectory.times, positions=through.trajectory.positions)
    for step in (
        lambda: see_through(through, LAYERS), lambda: set_medium(through, 2.0), lambda: set_one_way(through),
        lambda: ms.calibration.retime(through, log, ms.ClockCorrection(offset=0.0)),
        lambda: ms.imaging.estimate_clock(through, log, rng=0),
    ):  # fmt: skip
        with pytest.raises(ms.errors.InputError, match="the capture already has layers"):
            step()
    with pytest.raises(ms.errors.InputError, match="normal has length 2; expected 1"):
        replace(through.layers, normal=[0, 0, 2])
    with pytest.raises(ms.errors.InputError, match="thickness or a refractive index"):
        replace(through.layers, thicknesses=[0.1, 0.0, 0.1])
