"""`image_at`, the yardstick, against closed forms and invariances of Eq. 1."""

import numpy as np
import pytest

import millisight as ms
from helpers.oracles import C, point_frames, point_image, relative, width_3db
from millisight.core.errors import InputError

FREQUENCIES = 77.5e9 + 3e9 / 64 * np.arange(64)


@pytest.fixture
def bistatic():
    """Jittered, non-planar positions with two transmitters and four receivers."""
    rng = np.random.default_rng(1)
    tx = rng.uniform([-0.2, -0.2, -0.01], [0.2, 0.2, 0.01], (40, 1, 3)) + np.array([[[0, 0, 0], [0.004, 0, 0]]])
    rx = tx[:, :1] + np.array([[-0.005 - 0.002 * n, 0.001 * n, 0] for n in range(4)])
    return tx, rx


def scene(count=7, seed=2):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-0.08, -0.08, -0.36], [0.08, 0.08, -0.25], (count, 3))
    return points, rng.normal(size=count) + 1j * rng.normal(size=count)


@pytest.mark.parametrize("offset", [0.0, 0.15])
def test_equals_the_closed_form_of_a_point_reflector(bistatic, offset):
    at = np.array([0.013, -0.021, -0.31])
    points = np.concatenate([at[None], at + np.random.default_rng(3).normal(0, 0.01, (200, 3))])
    frames = point_frames(at[None], np.ones(1), *bistatic, FREQUENCIES, offset)
    values = ms.image_at(frames, *bistatic, FREQUENCIES, points, offset)
    assert np.abs(values - point_image(points, at, *bistatic, FREQUENCIES)).max() < 1e-10
    assert abs(values[0] - 1) < 1e-10


def test_uneven_frequencies_are_summed_as_given(bistatic):
    rng = np.random.default_rng(4)
    frequencies = np.sort(rng.uniform(77e9, 81e9, 23))
    points, amplitudes = scene()
    frames = point_frames(points, amplitudes, *bistatic, frequencies)
    values = ms.image_at(frames, *bistatic, frequencies, points)
    # Plain Eq. 1, one point at a time.
    d = (
        np.linalg.norm(points[:, None, None] - bistatic[0], axis=-1)[..., :, None]
        + np.linalg.norm(points[:, None, None] - bistatic[1], axis=-1)[..., None, :]
    )
    expected = [(frames * np.exp(2j * np.pi * d[v][..., None] * frequencies / C)).mean() for v in range(len(points))]
    assert np.abs(values - expected).max() < 1e-10


def test_even_and_uneven_kernels_agree(bistatic):
    points, amplitudes = scene()
    frames = point_frames(points, amplitudes, *bistatic, FREQUENCIES)
    shuffle = np.random.default_rng(5).permutation(len(FREQUENCIES))
    even = ms.image_at(frames, *bistatic, FREQUENCIES, points)
    uneven = ms.image_at(np.ascontiguousarray(frames[..., shuffle]), *bistatic, FREQUENCIES[shuffle], points)
    assert np.abs(even - uneven).max() < 1e-10


def test_imaging_is_the_adjoint_of_scattering(bistatic):
    """<A s, y> = <s, A* y>, with A the scattering of point reflectors and K N times imaging as A*."""
    points, amplitudes = scene()
    rng = np.random.default_rng(6)
    forward = point_frames(points, amplitudes, *bistatic, FREQUENCIES, 0.15)
    y = rng.normal(size=forward.shape) + 1j * rng.normal(size=forward.shape)
    backward = ms.image_at(y, *bistatic, FREQUENCIES, points, 0.15) * forward.size
    left, right = np.vdot(forward, y), np.vdot(amplitudes, backward)
    assert abs(left - right) / abs(left) < 1e-10


def test_superposition(bistatic):
    points, amplitudes = scene()
    where = points + 0.001
    parts = [
        ms.image_at(
            point_frames(points[i : i + 1], amplitudes[i : i + 1], *bistatic, FREQUENCIES),
            *bistatic,
            FREQUENCIES,
            where,
        )
        for i in range(len(points))
    ]
    whole = ms.image_at(point_frames(points, amplitudes, *bistatic, FREQUENCIES), *bistatic, FREQUENCIES, where)
    assert np.abs(sum(parts) - whole).max() < 1e-10


def test_translation_and_rotation_of_the_whole_set_up_change_nothing(bistatic):
    points, amplitudes = scene()
    frames = point_frames(points, amplitudes, *bistatic, FREQUENCIES)
    where = points + 0.002
    turn, _ = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))
    shift = np.array([1.0, -2.0, 0.5])
    moved = [np.ascontiguousarray(a @ turn.T + shift) for a in (*bistatic, where)]
    before = ms.image_at(frames, *bistatic, FREQUENCIES, where)
    after = ms.image_at(frames, moved[0], moved[1], FREQUENCIES, moved[2])
    assert np.abs(before - after).max() < 1e-9


def test_swapping_transmitters_and_receivers_changes_nothing(bistatic):
    tx, rx = bistatic
    points, amplitudes = scene()
    frames = point_frames(points, amplitudes, tx, rx, FREQUENCIES)
    swapped = np.ascontiguousarray(frames.transpose(0, 2, 1, 3))
    before = ms.image_at(frames, tx, rx, FREQUENCIES, points)
    after = ms.image_at(swapped, rx, tx, FREQUENCIES, points)
    assert np.abs(before - after).max() < 1e-10


def test_the_other_phase_sign_does_not_focus(bistatic):
    """Conjugated frames, the public code's sign, must not image: the sign matters, and the suite would notice."""
    at = np.array([[0.0, 0.0, -0.3]])
    frames = point_frames(at, np.ones(1), *bistatic, FREQUENCIES)
    assert abs(ms.image_at(frames, *bistatic, FREQUENCIES, at)[0]) > 0.999
    assert abs(ms.image_at(np.conj(frames), *bistatic, FREQUENCIES, at)[0]) < 0.2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frames": np.zeros((2, 1, 1))}, r"frames has shape \(2, 1, 1\); expected \(P, T, R, N\)"),
        ({"frames": np.full((2, 1, 1, 3), np.nan)}, "frames has 6 values that are NaN"),
        ({"tx_positions": np.zeros((1, 1, 3))}, r"tx_positions has shape \(1, 1, 3\); expected \(2, 1, 3\)"),
        ({"rx_positions": np.zeros((2, 2, 3))}, r"rx_positions has shape \(2, 2, 3\); expected \(2, 1, 3\)"),
        ({"rx_positions": np.zeros((2, 1, 2))}, "rx_positions has shape"),
        ({"frequencies": np.ones(2)}, r"frequencies has shape \(2,\); expected \(3,\)"),
        ({"frequencies": 1j * np.ones(3)}, "frequencies cannot be read .* complex"),
        ({"points": np.zeros(3)}, r"points has shape \(3,\); expected \(V, 3\)"),
        ({"points": np.zeros((4, 2))}, "points has shape"),
        ({"path_offset": np.nan}, "path_offset is nan"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(changes, message):
    """Compiled code would read beyond their ends."""
    good = {
        "frames": np.ones((2, 1, 1, 3), complex), "tx_positions": np.zeros((2, 1, 3)),
        "rx_positions": np.zeros((2, 1, 3)), "frequencies": np.array([1e9, 2e9, 3e9]), "points": np.ones((4, 3)),
    }  # fmt: skip
    assert len(ms.image_at(**good)) == 4
    with pytest.raises(InputError, match=message):
        ms.image_at(**(good | changes))


def test_other_kinds_of_numbers_give_the_same_image(bistatic):
    """Lists, float32, foreign byte order, integers, and arrays that lie askew in memory."""
    rng = np.random.default_rng(8)
    frames = rng.integers(-9, 9, (2, 1, 4, 64)).astype(np.int64)
    points = rng.integers(-3, 3, (5, 3)) / 4 + 0.125  # whole in float32
    tx, rx = np.round(bistatic[0][:2, :1] * 1024) / 1024, np.round(bistatic[1][:2] * 1024) / 1024
    expected = ms.image_at(frames.astype(complex), tx, rx, FREQUENCIES, points)
    askew = np.asfortranarray(points)
    others = ms.image_at(frames.tolist(), tx.astype(np.float32), rx.astype(">f8"), list(FREQUENCIES), askew)
    assert np.array_equal(expected, others)


def aperture_of(width_x, width_y, count=61):
    x, y = np.linspace(-0.5, 0.5, count) * width_x, np.linspace(-0.5, 0.5, count) * width_y
    grid = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return np.ascontiguousarray(grid)


def cut(at, axis, half_width, count=201):
    offsets = np.linspace(-half_width, half_width, count)
    points = np.tile(np.asarray(at, dtype=float), (count, 1))
    points[:, axis] += offsets
    return offsets, points


def simulated_width(antennas, frequencies, at, axis, half_width):
    offsets, points = cut(at, axis, half_width)
    frames = point_frames(np.asarray(at)[None], np.ones(1), antennas, antennas, frequencies)
    return width_3db(offsets, ms.image_at(frames, antennas, antennas, frequencies, points))


def quadrature_width(width_x, width_y, start, stop, at, axis, half_width):
    """The width from Eq. 1 as an integral over a continuous aperture and band, by Gauss-Legendre quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    x, y = nodes * width_x / 2, nodes * width_y / 2
    offsets, points = cut(at, axis, half_width)
    here = np.sqrt((at[0] - x[:, None]) ** 2 + (at[1] - y) ** 2 + at[2] ** 2)
    values = []
    for point in points:
        difference = 2 * (np.sqrt((point[0] - x[:, None]) ** 2 + (point[1] - y) ** 2 + point[2] ** 2) - here) / C
        # The integral over the band in closed form.
        band = np.exp(1j * np.pi * (start + stop) * difference) * np.sinc((stop - start) * difference)
        values.append(np.einsum("i,j,ij->", weights, weights, band))
    return width_3db(offsets, np.array(values))


@pytest.mark.parametrize("distance", [0.25, 0.35, 0.45])
@pytest.mark.parametrize(("axis", "half_width"), [(0, 0.004), (1, 0.004), (2, 0.015)])
def test_widths_near_by_agree_with_quadrature(distance, axis, half_width):
    """55 x 45 cm at 77 GHz, where the wavefront's curvature rules."""
    frequencies = 77.5e9 + 3e9 / 32 * (np.arange(32) + 0.5)
    at = np.array([0.0, 0.0, -distance])
    actual = simulated_width(aperture_of(0.55, 0.45), frequencies, at, axis, half_width)
    expected = quadrature_width(0.55, 0.45, 77.5e9, 80.5e9, at, axis, half_width)
    assert actual == pytest.approx(expected, rel=0.05)


def test_published_widths():
    """The figures that physics.md of the paper's set-up gives: 1.04 and 4.8 mm at 0.25 m, 1.55 and 9.7 mm at 0.45 m."""
    for distance, across, deep in ((0.25, 1.04e-3, 4.8e-3), (0.45, 1.55e-3, 9.7e-3)):
        at = np.array([0.0, 0.0, -distance])
        assert quadrature_width(0.55, 0.45, 77.5e9, 80.5e9, at, 0, 0.004) == pytest.approx(across, rel=0.05)
        assert quadrature_width(0.55, 0.45, 77.5e9, 80.5e9, at, 2, 0.015) == pytest.approx(deep, rel=0.05)


@pytest.mark.parametrize("axis", [0, 1])
def test_cross_range_resolution_far_away(axis):
    """0.886 lambda z0 / (2 D), and half of it for twice the aperture."""
    frequencies = 79e9 + 1e6 * np.arange(2)
    distance, wavelength = 1.0, C / 79e9
    widths = []
    for diameter in (0.15, 0.3):
        expected = 0.886 * wavelength * distance / (2 * diameter)
        antennas = aperture_of(diameter, diameter)
        widths.append(simulated_width(antennas, frequencies, np.array([0.0, 0.0, -distance]), axis, 1.5 * expected))
        assert widths[-1] == pytest.approx(expected, rel=0.05)
    assert widths[0] / widths[1] == pytest.approx(2, rel=0.05)


def test_range_resolution_far_away():
    """0.886 c / (2 B), the aperture under a sixth of the distance."""
    for bandwidth in (3e9, 6e9):
        frequencies = 77.5e9 + bandwidth / 128 * (np.arange(128) + 0.5)
        expected = 0.886 * C / (2 * bandwidth)
        at = np.array([0.0, 0.0, -1.2])
        antennas = aperture_of(0.05, 0.05, count=15)
        assert simulated_width(antennas, frequencies, at, 2, 1.5 * expected) == pytest.approx(expected, rel=0.05)


def test_a_reflector_peaks_at_its_place():
    """To a tenth of a fine voxel, by the parabola through the three highest values along each axis."""
    fine = 0.0002
    at = np.array([0.03137, -0.02241, -0.30273])
    antennas = aperture_of(0.3, 0.25, count=41)
    frames = point_frames(at[None], np.ones(1), antennas, antennas, FREQUENCIES)
    for axis in range(3):
        coordinates = np.round(at[axis] / fine) * fine + fine * np.arange(-8, 9)
        points = np.tile(at, (len(coordinates), 1))
        points[:, axis] = coordinates
        power = np.abs(ms.image_at(frames, antennas, antennas, FREQUENCIES, points)) ** 2
        top = int(np.argmax(power))
        assert 0 < top < len(power) - 1
        before, here, after = power[top - 1 : top + 2]
        peak = coordinates[top] + fine * (before - after) / (2 * (before - 2 * here + after))
        assert abs(peak - at[axis]) < fine / 10


def test_exact_through_records_is_good_to_single_precision(bistatic):
    radar = ms.Radar.preset("iwr1443")
    trajectory = ms.Trajectory(times=np.arange(40.0), positions=bistatic[0][:, 0])
    tx, rx = trajectory.placed(radar.array.tx_positions), trajectory.placed(radar.array.rx_positions)
    points, amplitudes = scene()
    frames = point_frames(points, amplitudes, tx, rx, radar.waveform.frequencies, radar.path_offset)
    grid = ms.VoxelGrid(x=np.sort(points[:, 0]), y=np.sort(points[:, 1]), z=np.sort(points[:, 2]))
    image = ms.form_image(ms.Capture(radar=radar, trajectory=trajectory, frames=frames), grid, method="exact")
    expected = ms.image_at(frames, tx, rx, radar.waveform.frequencies, grid.points, radar.path_offset)
    assert relative(image.values, expected) < 1e-6
