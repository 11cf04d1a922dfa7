"""Edges, double bounces and sheets against closed forms."""

import numpy as np
import pytest
import trimesh

import millisight as ms
from helpers.oracles import C, fresnel, relative
from helpers.scatter import METAL, cross_section, decibels, from_places, mesh_of, plate, radar, wedge_diffraction
from millisight.core.errors import InputError
from millisight.rig.virtual import Part, Sheet, box_sheets, echoes
from millisight.rig.virtual._edges import sharp_edges
from millisight.rig.virtual._path_kernels import _fringe
from millisight.rig.virtual._slabs import slab_coefficients

CARTON = ((2.62 - 0.105j, 0.22e-3), (1.13 - 0.007j, 2.56e-3), (2.62 - 0.105j, 0.22e-3))
BOARD = ((2.0 - 0.1j, 9e-3),)
BANDS = {"77 GHz": (77.5e9, 3e9 / 8), "24 GHz": (24.025e9, 2e8 / 8)}


def fringe_at(angle, n):
    """By the angle from the first face [rad]."""
    over, opening = np.pi / n, n * np.pi
    constants = np.cos(over), np.sin(over) / n, np.cos(opening), np.sin(opening)
    return _fringe.py_func(np.cos(angle), np.sin(angle), n, *constants)


@pytest.mark.parametrize("n", [1.5, 1.75, 2.0])
def test_fringes_and_physical_optics_make_a_wedges_wave(n):
    """Against the exact series of the wedge, from all sides but square on."""
    checked = 0
    for deg in (15, 35, 55, 75, 105, 150, 170, 200, 250):
        angle = np.radians(deg)
        seen = [turn for turn in (angle, n * np.pi - angle) if 0 < turn < np.pi]
        if angle >= n * np.pi or (n == 2.0 and deg > 180):
            continue
        optics = sum(np.tan(turn) / 2 for turn in seen)
        whole = fringe_at(angle, n) + optics
        assert abs(wedge_diffraction(n, angle) - whole) < 0.03 * abs(whole)
        checked += 1
    assert checked > 6


def test_fringes_are_finite_square_on_and_none_inside():
    near, at = fringe_at(np.pi / 2 + 1e-3, 1.5), fringe_at(np.pi / 2, 1.5)
    assert at == pytest.approx(near, abs=1e-3)
    assert fringe_at(1.6 * np.pi, 1.5) == 0


@pytest.mark.parametrize("n", [1.05, 1.4, 1.5, 1.9, 2.0])
def test_fringes_are_good_to_single_precision_next_to_where_their_terms_are_infinite(n):
    """By the library's cosine and arcus tangent."""
    away = np.geomspace(1.5e-4, 0.3, 40)
    square = np.concatenate([np.pi / 2 + away, np.pi / 2 - away])
    angles = np.concatenate([square, n * np.pi - square, np.linspace(0.01, 2 * np.pi, 200)])
    for angle in angles[(angles > 0) & (angles < n * np.pi)]:
        whole = -np.sin(np.pi / n) / n / (np.cos(np.pi / n) - np.cos(2 * angle / n))
        whole -= sum(np.tan(turn) / 2 for turn in (angle, n * np.pi - angle) if turn < np.pi)
        found = fringe_at(angle, n)
        if n == 2.0 and angle >= np.pi:
            assert found == 0
        elif min(abs(angle - np.pi / 2), abs(n * np.pi - angle - np.pi / 2)) > 1e-4:
            assert found == pytest.approx(whole, rel=1e-6, abs=1e-6)


def test_edges_mend_physical_optics_off_the_specular_angle():
    """A plate far away, in the plane across two of its edges, up to edge-on: their diffracted waves (Keller) are all.

    Edge-on, physical optics has nothing.
    """
    a, b, far = 0.08, 0.06, 300.0
    wavelength = C / 77e9
    angle = np.radians(np.linspace(4, 89.9, 150))
    places = far * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    k = 2 * np.pi / wavelength
    # Each edge's coefficient is 1 / (2 cos φ), seen at φ from the plate's surface; the nearer one is ahead in phase.
    ahead = np.exp(1j * k * a * np.sin(angle))
    expected = b / (4 * np.pi) * (ahead.conj() - ahead) / np.sin(angle)
    got = {}
    for edges in (False, True):
        part = Part(mesh=plate(a, b), material=METAL)
        echo = echoes([part], radar(77e9), from_places(places), edges=edges, bounces=1)[:, 0, 0, 0]
        got[edges] = echo * far**2 * np.exp(2j * k * far)
    assert relative(got[True], expected) < 0.02
    assert relative(got[False], expected) > 0.15
    grazing = angle > np.radians(60)
    assert relative(got[False][grazing], expected[grazing]) > 0.5
    assert relative(got[True][grazing], expected[grazing]) < 0.02


def test_which_edges_are_sharp():
    box = mesh_of(trimesh.creation.box((0.05, 0.04, 0.03)))
    edges = sharp_edges(box, 20.0, 0.003)
    assert edges.lengths.sum() == pytest.approx(4 * 0.12)
    assert edges.lengths.max() <= 0.003
    assert np.allclose(edges.openings, 1.5)
    outward = np.einsum("ei,ei->e", edges.lift, edges.middles)
    assert (outward > 0).all()
    assert np.allclose(np.einsum("ei,ei->e", edges.into, edges.normals), 0, atol=1e-12)
    # A soup of triangles is the same solid.
    soup = ms.TriangleMesh(vertices=box.vertices[box.faces].reshape(-1, 3), faces=np.arange(36).reshape(-1, 3))
    assert len(sharp_edges(soup, 20.0, 0.003)) == len(edges)
    assert sharp_edges(plate(0.05, 0.04), 20.0, 1.0).openings.tolist() == [2.0] * 4
    assert len(sharp_edges(mesh_of(trimesh.creation.icosphere(3, radius=0.03)), 20.0, 1.0)) == 0
    # An inner corner is left to double bounces.
    inner = sharp_edges(corner(0.05, 0.05), 20.0, 1.0)
    assert inner.openings.tolist() == [2.0] * 6


def corner(a, b):
    """Two plates at a right angle, a x b each, that face one another."""
    vertices = [[0, -b / 2, 0], [a, -b / 2, 0], [a, b / 2, 0], [0, b / 2, 0], [0, -b / 2, a], [0, b / 2, a]]
    return ms.TriangleMesh(vertices=vertices, faces=[[0, 1, 2], [0, 2, 3], [0, 3, 5], [0, 5, 4]])


@pytest.mark.parametrize("band", BANDS)
def test_a_dihedral_corner(band):
    """8 pi a² b² / lambda² between its faces; off that by the width that both see; silent without the bounce."""
    a = b = {"77 GHz": 0.05, "24 GHz": 0.1}[band]
    device = radar(*BANDS[band], 3)
    wavelength = C / device.waveform.center_frequency
    far = 10 * (2 * a**2 + b**2) / wavelength
    angle = np.radians([45.0, 38.0, 52.0, 45.0])
    places = far * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    places[3, 1] = 0.02 * far
    part = Part(mesh=corner(a, b), material=METAL)
    echo = echoes([part], device, from_places(places), edges=False)[:, 0, 0, 1]
    shares = np.sqrt(2) * np.minimum(np.sin(angle), np.cos(angle))
    expected = 8 * np.pi * a**2 * b**2 / wavelength**2 * shares**2
    assert abs(decibels(cross_section(echo, far) / expected)[:3]).max() < 1.0
    # Out of that plane it is a plate as long as the fold.
    out = np.arctan(0.02)
    sinc = np.sinc(2 * b * np.sin(out) / wavelength)
    assert abs(echo[3] / echo[0]) == pytest.approx(abs(sinc), abs=0.1)
    # Two conductors turn the wave by 2 pi, and the path is that to the fold.
    phase = np.angle(-1j * echo[0] * np.exp(4j * np.pi * far / wavelength))
    assert abs(phase) < 0.1
    single = echoes([part], device, from_places(places[:1]), edges=False, bounces=1)
    assert abs(single).max() < 0.05 * abs(echo[0])


def test_a_dihedral_of_other_matter_has_both_fresnel_factors():
    far, angle = 8.0, np.pi / 4
    place = from_places([far * np.sin(angle), 0.0, far * np.cos(angle)])
    metal, other = (
        echoes([Part(mesh=corner(0.05, 0.05), material=m)], radar(77e9), place, edges=False) for m in (METAL, 4 - 0.2j)
    )
    assert np.allclose(other / metal, fresnel(4 - 0.2j, np.sqrt(0.5)).mean() ** 2, rtol=0.05)


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("layers", [CARTON, BOARD], ids=["carton", "board"])
def test_through_a_sheet(band, layers):
    """What lies behind it: twice its transmission, loss and delay, over the band; straight and at an angle."""
    device = radar(*BANDS[band], 9)
    ball = Part(mesh=mesh_of(trimesh.creation.icosphere(4, radius=0.02)), material=METAL)
    sheet = Sheet(corner=[-0.07, -0.07, 0.05], u=[0.16, 0, 0], v=[0, 0.14, 0], layers=layers)
    settings = {"edges": False, "bounces": 1}
    for deg in (0, 35):
        place = from_places(0.3 * np.array([np.sin(np.radians(deg)), 0.0, np.cos(np.radians(deg))]))
        alone = echoes([ball], device, place, **settings)[0, 0, 0]
        board = echoes([], device, place, occluders=[sheet], **settings)
        both = echoes([ball], device, place, occluders=[sheet], **settings)
        t = slab_coefficients(layers, device.waveform.frequencies, np.cos(np.radians(deg)))[1].mean(axis=0)
        # What the ball hides of the sheet does not count: it lies behind.
        assert abs((both - board)[0, 0, 0] / alone - t**2).max() < 0.03 * abs(t**2).max()


@pytest.mark.parametrize("band", BANDS)
def test_a_sheets_own_reflection(band):
    """Against a metal plate in its place: its reflection, from its front; both sides."""
    device = radar(*BANDS[band], 9)
    u, v = [0.06, 0.0, 0.0], [0.0, 0.05, 0.0]
    for lopsided in (CARTON, (*CARTON, (4.0 - 0.2j, 1e-3))):
        sheet = Sheet(corner=[-0.03, -0.025, 0.0], u=u, v=v, layers=lopsided)
        depth = sum(thickness for _, thickness in lopsided)
        for side, order in ((1, 1), (-1, -1)):
            place = from_places([0.0, 0.0, 0.5 * side])
            got = echoes([], device, place, occluders=[sheet], edges=False)[0, 0, 0]
            metal = mesh_of(trimesh.creation.box((0.06, 0.05, 1e-6)))
            mirror = echoes([Part(mesh=metal, material=METAL)], device, place, edges=False, bounces=1)[0, 0, 0]
            k = 2 * np.pi * device.waveform.frequencies / C
            expected = -slab_coefficients(lopsided[::order], device.waveform.frequencies, 1.0)[0][0]
            # Near by, some of the plate is seen at an angle.
            assert abs(got / mirror - expected * np.exp(1j * k * depth)).max() < 0.05


def test_carton_shows_at_77_and_hardly_at_24_ghz():
    """Liner, flute, liner: what the liners reflect nearly cancels at 24 GHz; all goes through but for a decibel or two.

    Half a millimetre more or less of flute moves the reflection by up to 10 dB, and leaves it above that at 24 GHz.
    """
    for more in (-0.5e-3, 0.0, 0.5e-3):
        layers = (CARTON[0], (CARTON[1][0], CARTON[1][1] + more), CARTON[2])
        coefficients = {f: slab_coefficients(layers, f, 1.0) for f in (24.125e9, 79e9)}
        low, high = (decibels(abs(r[0]) ** 2) for r, _ in coefficients.values())
        assert low < -18
        assert high > low + 3
        assert min(decibels(abs(t[0]) ** 2) for _, t in coefficients.values()) > -2.5


def test_a_box_of_sheets():
    sheets = box_sheets([-0.1, -0.05, 0.0], [0.1, 0.05, 0.08], CARTON)
    assert len(sheets) == 6
    for sheet in sheets:
        middle = sheet.corner + (sheet.u + sheet.v) / 2
        assert np.cross(sheet.u, sheet.v) @ (middle - [0, 0, 0.04]) > 0
    assert sum(np.linalg.norm(np.cross(s.u, s.v)) for s in sheets) == pytest.approx(2 * (0.02 + 0.016 + 0.008))
    with pytest.raises(InputError, match="right angle"):
        Sheet(corner=[0, 0, 0], u=[1, 0, 0], v=[1, 1, 0], layers=CARTON)
    with pytest.raises(InputError, match="no layers"):
        Sheet(corner=[0, 0, 0], u=[1, 0, 0], v=[0, 1, 0], layers=())
