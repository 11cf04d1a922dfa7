"""Physical optics against closed forms and quadrature, and what any scatterer must obey."""

import numpy as np
import pytest
import trimesh

import millisight as ms
from helpers.oracles import C, fresnel, relative
from helpers.scatter import (
    BISTATIC,
    METAL,
    cross_section,
    decibels,
    from_places,
    mesh_of,
    mie_cross_section,
    plate,
    plate_sum,
    radar,
)
from millisight.core import rotation_from_euler_deg
from millisight.core.errors import CoverageError, InputError
from millisight.rig.virtual import Antenna, EchoModel, Part, echoes
from millisight.rig.virtual._slabs import slab_coefficients

BANDS = {"77 GHz": (77.5e9, 3e9 / 8), "24 GHz": (24.025e9, 2e8 / 8)}
PLAIN = {"edges": False, "bounces": 1}
PLATE = plate(0.06, 0.05)
BALL = trimesh.creation.icosphere(4, radius=0.03)


def near_places(count=12, seed=0):
    return from_places(np.random.default_rng(seed).uniform([-0.15, -0.15, 0.15], [0.15, 0.15, 0.25], (count, 3)))


@pytest.mark.parametrize("band", BANDS)
def test_flat_plate_far_away(band):
    """4 pi A² / lambda² at 10 D² / lambda and beyond, in all of the band; its range by phase."""
    device = radar(*BANDS[band], 9)
    frequencies = device.waveform.frequencies
    for factor in (10, 40):
        far = factor * (0.06**2 + 0.05**2) * frequencies[-1] / C
        echo = echoes([Part(mesh=PLATE, material=METAL)], device, from_places([0, 0, far]), **PLAIN)[0, 0, 0]
        expected = 4 * np.pi * (0.06 * 0.05) ** 2 * frequencies**2 / C**2
        assert abs(decibels(cross_section(echo, far) / expected)).max() < 0.05
        # A conductor turns the wave by pi, and the far plate's sum over all directions by another quarter turn.
        phase = np.angle(echo * 1j * np.exp(4j * np.pi * frequencies * far / C))
        assert abs(phase).max() < 1.2 / factor


@pytest.mark.parametrize("band", BANDS)
def test_sphere_is_mies(band):
    """ka from 32 to 50, from three sides, at 10 D² / lambda."""
    radius = {"77 GHz": 0.02, "24 GHz": 0.07}[band]
    device = radar(*BANDS[band], 9)
    frequencies = device.waveform.frequencies
    assert 2 * np.pi * frequencies[0] * radius / C > 30
    far = 10 * (2 * radius) ** 2 * frequencies[-1] / C
    ball = mesh_of(trimesh.creation.icosphere(5, radius=radius))
    places = far * np.array([[0, 0, 1], [0.6, 0, 0.8], [0.36, -0.48, -0.8]])
    echo = echoes([Part(mesh=ball, material=METAL)], device, from_places(places), **PLAIN)[:, 0, 0]
    expected = np.array([mie_cross_section(radius, f) for f in frequencies])
    assert abs(decibels(cross_section(echo, far) / expected)).max() < 0.25
    # 0.02 rad are 6 micrometres of range at 77 GHz.
    phase = np.angle(-echo * np.exp(4j * np.pi * frequencies * (far - radius) / C))
    assert abs(phase).max() < 0.05
    assert abs(phase.mean()) < 0.02


@pytest.mark.parametrize("band", BANDS)
def test_plate_near_by_is_its_integral(band):
    """From anywhere at 15 to 25 cm, transmitter and receiver together and apart."""
    device = radar(*BANDS[band], 9, array=BISTATIC, path_offset=0.15)
    places = near_places()
    got = echoes([Part(mesh=PLATE, material=METAL)], device, places, **PLAIN)
    frequencies = device.waveform.frequencies
    expected = np.array(
        [[[plate_sum(0.06, 0.05, p, p + r, frequencies) for r in BISTATIC.rx_positions]] for p in places.positions]
    )
    expected *= np.exp(-2j * np.pi * frequencies * 0.15 / C)
    assert relative(got, expected) < 6e-3
    for j in (0, 8):
        assert relative(got[..., j], expected[..., j]) < 8e-3


def test_a_wide_band_is_still_right():
    """15 GHz: bins and clusters shrink with it."""
    device = radar(70e9, 3e9, 6)
    places = near_places(5)
    got = echoes([Part(mesh=PLATE, material=METAL)], device, places, **PLAIN)[:, 0, 0]
    expected = [plate_sum(0.06, 0.05, p, p, device.waveform.frequencies) for p in places.positions]
    assert relative(got[:, 2:4], np.array(expected)[:, 2:4]) < 4e-3
    # Patches have their form at the band's centre: a tenth off, at its ends, that shows far from the specular angle.
    assert relative(got, expected) < 0.03


@pytest.mark.parametrize("permittivity", [2.7 - 0.02j, 6 - 0.1j, 8 - 12j, 1.05])
def test_a_dielectric_reflects_by_its_fresnel_factor(permittivity):
    box = mesh_of(trimesh.creation.box((0.05, 0.04, 0.03)))
    device = radar(*BANDS["77 GHz"], 3)
    over = from_places([0.0, 0.0, 0.3])
    metal, other = (echoes([Part(mesh=box, material=m)], device, over, **PLAIN) for m in (METAL, permittivity))
    expected = -fresnel(permittivity, 1.0)[0]
    assert abs(expected) < 0.75
    assert np.allclose(other / metal, expected, rtol=0.02)


def test_a_wall_rings_across_the_band():
    """A bottle's wall: both its faces reflect, and the band shows it."""
    device = radar(74e9, 1e9, 9)
    over = from_places([0.0, 0.0, 0.4])
    metal = echoes([Part(mesh=PLATE, material=METAL)], device, over, **PLAIN)[0, 0, 0]
    wall = echoes([Part(mesh=PLATE, material=2.6 - 0.02j, wall=4e-3)], device, over, **PLAIN)[0, 0, 0]
    expected = -slab_coefficients([(2.6 - 0.02j, 4e-3)], device.waveform.frequencies, 1.0)[0][0]
    assert np.ptp(abs(expected)) > 0.1
    assert abs(wall / metal - expected).max() < 0.02


@pytest.mark.slow
def test_swapping_transmitter_and_receiver_changes_nothing():
    """With shadows, antennas, and roughness; double bounces are found from the transmitter's side and left out."""
    ring = mesh_of(trimesh.creation.torus(0.04, 0.015)).moved(rotation=rotation_from_euler_deg((50, 20, 0)))
    part = Part(mesh=ring, material=3 - 0.1j, roughness=2e-4)
    rng = np.random.default_rng(3)
    a, b = rng.uniform([-0.2, -0.2, 0.15], [0.2, 0.2, 0.3], (2, 6, 3))
    settings = {"bounces": 1, "antenna": Antenna(beamwidth_x_deg=60, beamwidth_y_deg=80), "rng": 5}
    for one, other in zip(a, b, strict=True):
        forth, back = (
            echoes([part], radar(*BANDS["77 GHz"], 5, array=ms.AntennaArray(tx_positions=[[0, 0, 0]],
                   rx_positions=[stop - start])), from_places(start), **settings)
            for start, stop in ((one, other), (other, one))
        )  # fmt: skip
        assert abs(forth).max() > 1e-4
        assert relative(forth, back) < 1e-5


@pytest.mark.slow
def test_echoes_of_things_apart_add_up():
    ball = mesh_of(BALL).moved(translation=np.array([0.1, 0.0, 0.0]))
    wall = plate(0.05, 0.05, shift=(-0.08, 0.03))
    device, places = radar(*BANDS["77 GHz"], 9, array=BISTATIC), near_places(20)
    parts = Part(mesh=ball, material=METAL), Part(mesh=wall, material=5 - 0.5j)
    both = echoes(parts, device, places, bounces=1)
    single = [echoes([part], device, places, bounces=1) for part in parts]
    assert min(abs(s).max() for s in single) > 0.01
    assert relative(both, sum(single)) < 1e-5


@pytest.mark.slow
def test_shadows():
    """A ball behind a plate is silent, one beside it is not."""
    ball = Part(mesh=mesh_of(BALL), material=METAL)
    device, over = radar(*BANDS["77 GHz"], 9), near_places(20)
    alone = echoes([ball], device, over, **PLAIN)
    assert abs(alone).min() > 0.1
    for shift, seen in ((0.0, 0.0), (0.5, 1.0)):
        shade = Part(mesh=plate(0.2, 0.2, z=0.1, shift=(shift, 0.0)), material=METAL)
        without = echoes([shade], device, over, **PLAIN)
        both = echoes([ball, shade], device, over, **PLAIN)
        assert abs(both - without - seen * alone).max() < 1e-5 * max(abs(without).max(), abs(alone).max())


@pytest.mark.slow
def test_shared_views_agree_with_casting_every_ray(monkeypatch):
    """A hollow ring on a plate; every antenna's own rays instead of those of a cell's corners."""
    from millisight.rig.virtual._shadows import ShadowCells

    ring = mesh_of(trimesh.creation.torus(0.05, 0.01)).moved(rotation=rotation_from_euler_deg((40, 20, 0)))
    parts = Part(mesh=ring, material=METAL), Part(mesh=plate(0.12, 0.12, z=-0.06), material=METAL)
    device = radar(*BANDS["24 GHz"], 9)
    places = ms.Trajectory.raster(size=(0.1, 0.1), step=0.009, center=(0, 0, 0.25))
    shared_view = echoes(parts, device, places)

    def every_ray(self, antennas):
        return np.stack([self._view(antenna) for antenna in antennas])

    monkeypatch.setattr(ShadowCells, "light", every_ray)
    exhaustive = echoes(parts, device, places)
    assert abs(exhaustive).max() > 0.01
    # Hard shadows send out waves of their own from their rims; soft ones do less.
    assert relative(shared_view, exhaustive) < 0.15


@pytest.mark.slow
def test_row_by_row_is_all_at_once():
    """A scan's rows asked for one after the other, off their plan by less than a millimetre."""
    ring = mesh_of(trimesh.creation.torus(0.04, 0.012))
    parts = Part(mesh=ring, material=METAL), Part(mesh=plate(0.12, 0.12, z=-0.02), material=3 - 0.1j, roughness=1e-4)
    device = radar(*BANDS["77 GHz"], 9, array=BISTATIC)
    plan = ms.Trajectory.raster(size=(0.1, 0.09), step=0.01, center=(0, 0, 0.25))
    strayed = from_places(plan.positions + np.random.default_rng(0).normal(0, 3e-4, plan.positions.shape))
    model = EchoModel(parts, device, plan, rng=1)
    whole = model.frames(strayed)
    rows = [model.frames(from_places(strayed.positions[i : i + 10])) for i in range(0, 110, 10)]
    assert relative(np.concatenate(rows), whole) < 1e-5
    assert relative(whole, echoes(parts, device, strayed, rng=1)) < 0.05


def test_rough_plates_scatter_what_they_do_not_mirror():
    """Over places and seeds: the mean is Ament's, the variance Lambert's; a seed gives the same bytes."""
    roughness, height = 3e-4, 0.3
    device = radar(77e9, 1e9, 1)
    over = ms.Trajectory.raster(size=(0.1, 0.1), step=0.0125, center=(0, 0, height))
    rough = Part(mesh=PLATE, material=METAL, roughness=roughness)
    k = 2 * np.pi * 77e9 / C
    draws = np.array([echoes([rough], device, over, rng=seed, **PLAIN).ravel() for seed in range(12)])
    smooth = echoes([Part(mesh=PLATE, material=METAL)], device, over, **PLAIN).ravel()
    mirrored = (draws.mean(axis=0) * smooth.conj()).sum() / (abs(smooth) ** 2).sum()
    assert mirrored == pytest.approx(np.exp(-2 * (k * roughness) ** 2), rel=0.05)
    x, y = np.meshgrid((np.arange(60) + 0.5) / 1000 - 0.03, (np.arange(50) + 0.5) / 1000 - 0.025)
    far = np.linalg.norm(over.positions - np.stack([x, y, 0 * x], axis=-1).reshape(-1, 1, 3), axis=2)
    albedo = 1 - np.exp(-4 * (k * roughness * height / far) ** 2)
    expected = (albedo / np.pi * (height / far) ** 2 / far**4).sum(axis=0) * 1e-6
    assert np.mean(np.var(draws, axis=0, ddof=1) / expected) == pytest.approx(1, rel=0.1)
    assert np.array_equal(draws[3], echoes([rough], device, over, rng=3, **PLAIN).ravel())


@pytest.mark.slow
@pytest.mark.parametrize("incidence_deg", [0, 40, 75])
def test_scattered_power_is_not_created(incidence_deg):
    """Into the whole half-space, from a rough plate: less than the mirror loses."""
    roughness, side = 4e-4, 0.02
    small = Part(mesh=plate(side, side), material=METAL, roughness=roughness)
    angle, far = np.radians(incidence_deg), 0.5
    start = far * np.array([np.sin(angle), 0.0, np.cos(angle)])
    nodes, weights = np.polynomial.legendre.leggauss(8)
    cosines = (1 + nodes[:, None]) / 2
    turns = 2 * np.pi * np.arange(8) / 8
    sines = np.sqrt(1 - cosines**2)
    ends = np.stack([sines * np.cos(turns), sines * np.sin(turns), np.broadcast_to(cosines, (8, 8))], -1)
    array = ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=far * ends.reshape(-1, 3) - start)
    device = radar(77e9, 1e9, 1, array=array)
    rough = [echoes([small], device, from_places(start), rng=seed, **PLAIN)[0, 0, :, 0] for seed in range(12)]
    density = np.var(rough, axis=0, ddof=1).reshape(8, 8) * far**2
    scattered = (weights / 2 * density.mean(axis=1)).sum() * 2 * np.pi
    arriving = side**2 * np.cos(angle) / far**2
    k = 2 * np.pi * 77e9 / C
    lost = -np.expm1(-((2 * k * roughness * np.cos(angle)) ** 2))
    assert 0.2 * lost < scattered / arriving < lost


def test_the_antennas_pattern_and_where_it_looks():
    """A small ball all around, seen by a radar that is turned."""
    from scipy.spatial.transform import Rotation

    antenna = Antenna(beamwidth_x_deg=56, beamwidth_y_deg=28)
    ball = Part(mesh=mesh_of(trimesh.creation.icosphere(3, radius=0.004)), material=METAL)
    places = near_places(25, seed=2)
    turns = Rotation.random(25, random_state=1)
    oriented = ms.Trajectory(times=places.times, positions=places.positions, orientations=turns.as_quat())
    device = radar(77e9, 1e9, 1)
    ratio = (
        echoes([ball], device, oriented, antenna=antenna, **PLAIN) / echoes([ball], device, places, **PLAIN)
    ).ravel()
    seen = antenna.amplitude(turns.inv().apply(-places.positions))
    assert 5 < (seen > 0.05).sum() < 20
    assert abs(ratio - seen**2).max() < 0.01
    # Half the power at half the beamwidth, in either plane.
    for axis, width in enumerate((56, 28)):
        aim = np.zeros(3)
        aim[axis], aim[2] = np.sin(np.radians(width / 2)), -np.cos(np.radians(width / 2))
        assert antenna.amplitude(aim) ** 2 == pytest.approx(0.5)
    assert decibels(antenna.gain) == pytest.approx(decibels(4 * np.pi / np.radians(56) / np.radians(28)), abs=1.0)


def test_nothing_returns_nothing_and_progress_ends_at_all():
    device, places = radar(77e9, 1e9, 4), near_places(7)
    assert not echoes([], device, places).any()
    seen = []
    echoes([Part(mesh=PLATE, material=METAL)], device, places, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (7, 7)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_what_cannot_be_right_is_refused():
    device, places = radar(77e9, 1e9, 4), near_places(2)
    rough = Part(mesh=PLATE, material=METAL, roughness=1e-4)
    with pytest.raises(InputError, match="rng"):
        echoes([rough], device, places)
    with pytest.raises(InputError, match="bounces"):
        echoes([rough], device, places, bounces=3)
    with pytest.raises(InputError, match="conjugate"):
        echoes([Part(mesh=PLATE, material=3 + 1j)], device, places)
    with pytest.raises(CoverageError, match="raise the aperture"):
        echoes([Part(mesh=PLATE, material=METAL)], device, from_places([0.0, 0.0, 0.01]))
