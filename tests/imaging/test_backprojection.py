"""Backprojection against the exact imager, in every way it could go wrong."""

import numba
import numpy as np
import pytest

import millisight as ms
from helpers.forging import forge
from helpers.oracles import C, point_frames, relative
from millisight.core.errors import InputError, UnknownNameError


def form_image(capture, grid, method="backprojection", **settings):
    """`ms.form_image` by direct backprojection unless told otherwise."""
    return ms.form_image(capture, grid, method=method, **settings)


RADARS = ("iwr1443", "position2go")


def jittered_capture(name, *, poses=150, reflectors=40, seed=0):
    """Random reflectors seen from jittered, non-planar positions, with the radar's own offsets."""
    rng = np.random.default_rng(seed)
    radar = ms.Radar.preset(name)
    positions = rng.uniform([-0.2, -0.2, -0.01], [0.2, 0.2, 0.01], (poses, 3))
    trajectory = ms.Trajectory(times=np.arange(float(poses)), positions=positions)
    points = rng.uniform([-0.08, -0.08, -0.36], [0.08, 0.08, -0.25], (reflectors, 3))
    amplitudes = rng.normal(size=reflectors) + 1j * rng.normal(size=reflectors)
    frames = point_frames(
        points,
        amplitudes,
        trajectory.placed(radar.array.tx_positions),
        trajectory.placed(radar.array.rx_positions),
        radar.waveform.frequencies,
        radar.path_offset,
    )
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames)


GRID = ms.VoxelGrid.regular((-0.08, -0.08, -0.35), (0.08, 0.08, -0.25), (0.008, 0.008, 0.02))


@pytest.fixture(scope="module", params=RADARS)
def pair(request):
    capture = jittered_capture(request.param)
    return capture, form_image(capture, GRID, method="exact")


def test_within_one_per_cent_of_exact(pair):
    capture, exact = pair
    assert relative(form_image(capture, GRID).values, exact.values) < 0.002


def test_error_falls_with_the_square_of_oversampling(pair):
    """The table of docs/explanation/primer.md, primer (8)."""
    capture, exact = pair
    errors = {n: relative(form_image(capture, GRID, oversampling=n).values, exact.values) for n in (2, 4, 8, 16)}
    assert errors[2] < 0.05
    for n in (2, 4, 8):
        assert 2.5 < errors[n] / errors[2 * n] < 7
    assert errors[16] < 0.0005


@pytest.mark.parametrize("window", ["hann", "taylor", ("hann", None), (None, "taylor")])
def test_windows_agree_with_exact(pair, window):
    capture, exact = pair
    windowed = form_image(capture, GRID, window=window)
    assert relative(windowed.values, form_image(capture, GRID, method="exact", window=window).values) < 0.005
    # An accepted argument changes the result; a window over 200 MHz changes little in a volume of 10 cm.
    assert relative(windowed.values, exact.values) > (0.05 if "iwr" in capture.radar.name else 0.001)


def test_bytes_do_not_depend_on_the_number_of_threads(pair):
    capture, _ = pair
    images = []
    before = numba.get_num_threads()
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            images.append(form_image(capture, GRID).values.tobytes())
    finally:
        numba.set_num_threads(before)
    if len(images) < 2:
        pytest.skip("one core: nothing to compare")
    assert images[0] == images[1]


def test_a_capture_on_disk_is_imaged_in_blocks_with_the_same_result(pair, tmp_path, monkeypatch):
    from millisight.imaging import _backprojection as backprojection

    capture, _ = pair
    ms.save(tmp_path / "c.h5", capture)
    calls = []
    monkeypatch.setattr(backprojection, "_BLOCK_BYTES", capture.frames.nbytes // 5)
    with ms.open_capture(tmp_path / "c.h5") as on_disk:
        assert not on_disk.in_memory
        image = form_image(on_disk, GRID, progress=lambda done, total: calls.append((done, total)))
    assert len(calls) > 3
    assert calls[-1] == (150, 150)
    assert relative(image.values, form_image(capture, GRID).values) < 1e-5


@pytest.mark.parametrize("name", RADARS)
def test_a_unit_reflector_images_to_one(name):
    radar = ms.Radar.preset(name)
    trajectory = ms.Trajectory.raster(size=(0.1, 0.1), step=0.01, center=(0, 0, 0.3))
    tx, rx = trajectory.placed(radar.array.tx_positions), trajectory.placed(radar.array.rx_positions)
    frames = point_frames(np.zeros((1, 3)), np.ones(1), tx, rx, radar.waveform.frequencies, radar.path_offset)
    capture = ms.Capture(radar=radar, trajectory=trajectory, frames=frames)
    grid = ms.VoxelGrid(x=[0.0], y=[0.0], z=[0.0])
    for window in (None, "hann", "taylor"):
        assert abs(form_image(capture, grid, window=window).values[0, 0, 0] - 1) < 0.005


@pytest.mark.slow
def test_windows_lower_the_sidelobes():
    radar = ms.Radar.preset("mito-sim-77ghz")
    trajectory = ms.Trajectory.raster(size=(0.2, 0.2), step=0.004, center=(0, 0, 1.0))
    tx = trajectory.placed(radar.array.tx_positions)
    frames = point_frames(np.zeros((1, 3)), np.ones(1), tx, tx, radar.waveform.frequencies)
    capture = ms.Capture(radar=radar, trajectory=trajectory, frames=frames)
    # Along x: outside the main lobe, which ends at lambda z0 / D = 19 mm even with Hann.
    grid = ms.VoxelGrid(x=np.arange(0.021, 0.08, 0.001), y=[0.0], z=[0.0])
    highest = {}
    for window in (None, "hann", "taylor"):
        image = form_image(capture, grid, window=(None, window))
        highest[window] = 20 * np.log10(image.magnitude.max())
    assert highest[None] > -19
    assert highest["hann"] < -30
    assert -40 < highest["taylor"] < -28


def test_far_from_the_origin_of_the_world():
    """A frame counted from a robot's base, or from a map: the image does not lose its phase to float32."""
    capture = jittered_capture("iwr1443", poses=40)
    shift = np.array([3000.0, -4000.0, 500.0])
    moved = ms.Capture(
        radar=capture.radar,
        trajectory=ms.Trajectory(times=capture.trajectory.times, positions=capture.trajectory.positions + shift),
        frames=capture.frames,
    )
    grid = ms.VoxelGrid(x=GRID.x + shift[0], y=GRID.y + shift[1], z=GRID.z + shift[2])
    assert relative(form_image(moved, grid).values, form_image(capture, GRID).values) < 1e-3


def one_channel(samples=16, position=(0.0, 0.0, 0.0)):
    waveform = ms.Waveform.stepped(77e9, 1e8, samples)
    radar = ms.Radar(name="test", waveform=waveform, array=ms.AntennaArray.monostatic())
    trajectory = ms.Trajectory(times=[0.0], positions=[position])
    tx = trajectory.placed(radar.array.tx_positions)
    frames = point_frames(np.array([[0.0, 0.0, -0.3]]), np.ones(1), tx, tx, waveform.frequencies)
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames)


@pytest.mark.parametrize(
    ("capture", "grid"),
    [
        (one_channel(), ms.VoxelGrid(x=[0.0], y=[0.0], z=[-0.3])),
        (one_channel(), ms.VoxelGrid(x=[0.0], y=[0.0], z=[0.0])),  # the voxel is the antenna
        (one_channel(), ms.VoxelGrid.regular((-0.1, -0.1, 0.2), (0.1, 0.1, 0.4), 0.05)),  # behind the radar
        (one_channel(), ms.VoxelGrid.regular((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1), 0.05)),  # around the antenna
        (one_channel(samples=1), ms.VoxelGrid.regular((-0.1, -0.1, -0.3), (0.1, 0.1, -0.2), 0.05)),
    ],
)
def test_degenerate_captures_and_grids_are_right(capture, grid):
    exact = form_image(capture, grid, method="exact").values
    assert np.abs(form_image(capture, grid, oversampling=64).values - exact).max() < 1e-3


def test_coincident_positions_weigh_twice():
    capture = one_channel()
    twice = ms.Capture(
        radar=capture.radar,
        trajectory=ms.Trajectory(times=[0.0, 1.0], positions=np.repeat(capture.trajectory.positions, 2, axis=0)),
        frames=np.repeat(capture.frames, 2, axis=0),
    )
    grid = ms.VoxelGrid(x=[0.0], y=[0.0], z=[-0.3, -0.2])
    assert np.abs(form_image(twice, grid).values - form_image(capture, grid).values).max() < 1e-6


def test_nan_frames_are_refused(tmp_path):
    def spoil(file):
        file["frames"][0, 0, 0, 3] = np.nan

    capture = one_channel()
    frames = np.array(capture.frames)
    frames[0, 0, 0, 3] = np.nan
    with pytest.raises(InputError, match=r"frames has 1 values that are NaN or infinite, the first at \(0, 0, 0, 3\)"):
        ms.Capture(radar=capture.radar, trajectory=capture.trajectory, frames=frames)
    ms.save(tmp_path / "c.h5", capture)
    forge(tmp_path / "c.h5", spoil)
    grid = ms.VoxelGrid(x=[0.0], y=[0.0], z=[-0.3])
    with ms.open_capture(tmp_path / "c.h5") as on_disk, pytest.raises(InputError, match="NaN"):
        form_image(on_disk, grid)


def test_unknown_arguments_are_named():
    capture, grid = one_channel(), ms.VoxelGrid(x=[0.0], y=[0.0], z=[-0.3])
    with pytest.raises(UnknownNameError, match="backprojection"):
        ms.form_image(capture, grid, method="backproject")
    with pytest.raises(UnknownNameError, match="hann"):
        form_image(capture, grid, window="hanning")
    with pytest.raises(UnknownNameError, match="device"):
        form_image(capture, grid, device="tpu")
    with pytest.raises(InputError, match="oversampling"):
        form_image(capture, grid, oversampling=0)


def test_polynomials_of_the_phase_law():
    from millisight.core import phase

    turns = np.linspace(-0.5, 0.5, 100_001, dtype=np.float32)
    exact = np.exp(2j * np.pi * turns.astype(float))
    assert np.abs(phase.cosine(turns) + 1j * phase.sine(turns) - exact).max() < 2e-6
    assert phase.wrapped(np.float64(C)) == 0
