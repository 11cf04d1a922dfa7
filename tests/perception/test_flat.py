"""Plane, axis and sides of flat tops, by the phases of an image."""

import numpy as np
import pytest

import millisight as ms
from helpers.form_images import GRID, WAVENUMBER, ball, bulging, cylinder, flat, lit
from millisight.core.errors import InputError
from millisight.imaging import remove_sheets
from millisight.perception.segmentation import find_flat, find_round, why_no_forms

HALF = -6.0
CENTRE = (0.01, -0.02, -0.06)


def of(image):
    return find_flat(lit(image, HALF), image)


def degrees(one, other):
    return np.degrees(np.arccos(min(abs(float(np.dot(one, other))), 1.0)))


@pytest.mark.parametrize(
    ("sides", "tilt_deg", "turn_deg"),
    [((0.08, 0.05), (0, 0), 0), ((0.08, 0.05), (4, -6), 30), ((0.06, 0.06), (0, 9), 20), ((0.1, 0.025), (-8, 2), 120)],
)
def test_a_rectangle_is_as_large_and_as_tilted_as_it_is(sides, tilt_deg, turn_deg):
    (found,) = of(flat(sides, CENTRE, tilt_deg, turn_deg))
    sines = np.sin(np.radians(tilt_deg))
    assert found.kind == "rectangle"
    assert degrees(found.normal, [*sines, np.sqrt(1 - sines @ sines)]) < 0.1
    assert found.centre == pytest.approx(CENTRE, abs=0.0013)  # half a pixel
    assert found.sides == pytest.approx(sides, abs=0.0025)  # a pixel
    assert np.linalg.norm(found.axis) == pytest.approx(1)
    assert found.axis @ found.normal == pytest.approx(0, abs=1e-9)
    turned = np.degrees(np.arctan2(found.axis[1], found.axis[0])) % 180
    if sides[0] > sides[1]:
        assert min(abs(turned - turn_deg % 180), 180 - abs(turned - turn_deg % 180)) < 1.5
    assert found.axis[:2].sum() > 0
    assert found.share > 0.9
    assert found.tilt_deg == pytest.approx(degrees(found.normal, [0, 0, 1]))


def test_an_ellipse_has_its_diameters():
    (found,) = of(flat((0.08, 0.06), CENTRE, (5, 5), 60, "ellipse"))
    assert found.kind == "ellipse"
    assert found.sides == pytest.approx([0.08, 0.06], abs=0.0015)
    assert found.plain["kind"] == "ellipse"
    assert found.plain["centre"] == list(found.centre)
    assert str(found).startswith("flat ellipse of 80 x 60 mm around (0.010, -0.020, -0.060) m")


@pytest.mark.parametrize("radius", [0.25, 0.6, 2.0, -0.6])
def test_a_dome_and_a_barrel_bend_as_they_do(radius):
    for dome in (True, False):
        image = bulging((0.0812, 0.0612), CENTRE, radius, dome=dome)
        for one in (image, ms.SarImage(grid=GRID, values=np.conj(image.values))):
            (found,) = of(one)
            assert found.kind == "rectangle"
            assert np.diag(found.curvatures) == pytest.approx([1 / radius, dome / radius], rel=0.03, abs=0.02)
            assert found.twist_deg == pytest.approx(0, abs=0.3)
            assert found.sides == pytest.approx([0.0812, 0.0612], abs=0.004)
            assert degrees(found.normal, [0, 0, 1]) < 0.3
            assert found.centre == pytest.approx(CENTRE, abs=0.0025)
            bends = abs(found.bends_deg)
            assert str(found).startswith("bent" if bends.max() >= 3 else "flat")
            told = f"{'bulges' if radius > 0 else 'hollow'} by {bends[0]:.0f} degrees along"
            assert (told in str(found)) == (bends[0] >= 3)
            assert found.plain["curvatures"] == found.curvatures.tolist()


@pytest.mark.parametrize("kind", ["rectangle", "ellipse"])
def test_its_outline_lies_around_its_pixels(kind):
    image = flat((0.08, 0.05), CENTRE, (4, -6), 30, kind)
    (found,) = of(image)
    places = np.stack(np.meshgrid(GRID.x, GRID.y, indexing="ij"), axis=-1)[found.inside]
    for angle in np.radians(range(0, 360, 15)):
        way = np.array([np.cos(angle), np.sin(angle)])
        assert (found.outline @ way).max() == pytest.approx((places @ way).max(), abs=0.004)
    assert found.outline[0] == pytest.approx(found.outline[-1])
    assert found.short == "80 x 50 mm"


def test_a_twisted_top_is_no_plane():
    x, y = GRID.x[:, None] - CENTRE[0], GRID.y - CENTRE[1]
    values = flat((0.08, 0.05), CENTRE).values * np.exp(-1j * WAVENUMBER * 4.0 * x * y)[..., None]
    for one in (values, np.conj(values)):
        (found,) = of(ms.SarImage(grid=GRID, values=one))
        assert abs(found.curvatures[0, 1]) == pytest.approx(4, rel=0.05)
        assert np.diag(found.curvatures) == pytest.approx([0, 0], abs=0.1)
        assert "bent rectangle" in str(found)
        assert f"twisted by {abs(found.twist_deg):.0f} degrees" in str(found)


def test_a_disc_has_the_axis_along_which_it_bends_most():
    image = bulging((0.081, 0.081), (*CENTRE[:2], -0.05), 0.3, dome=False)
    round_ = (np.hypot(GRID.x[:, None] - CENTRE[0], GRID.y - CENTRE[1]) <= 0.04)[..., None]
    (found,) = of(ms.SarImage(grid=GRID, values=image.values * round_))
    assert found.kind == "ellipse"
    assert np.diag(found.curvatures) == pytest.approx([1 / 0.3, 0], rel=0.05, abs=0.1)
    assert abs(found.axis[0]) == pytest.approx(1, abs=0.01)


def test_two_tops_half_a_wavelength_apart_are_none_together():
    """Their phases are those of one top, their heights are not."""
    step = 8 * np.pi / WAVENUMBER
    low, high = (flat((0.05, 0.05), (x, 0, -0.06 + z)).values for x, z in ((-0.026, 0), (0.026, step)))
    both = ms.SarImage(grid=GRID, values=low + high)
    assert of(both) == ()
    alike = ms.SarImage(grid=GRID, values=low + flat((0.05, 0.05), (0.026, 0, -0.06)).values)
    assert len(of(alike)) == 1


def test_a_top_must_lie_within_the_image():
    image = flat((0.08, 0.05), CENTRE)
    below = GRID.z < CENTRE[2] - 0.005
    cut = ms.VoxelGrid(x=GRID.x, y=GRID.y, z=GRID.z[below])
    assert of(ms.SarImage(grid=cut, values=image.values[..., below])) == ()


@pytest.mark.parametrize("made", [True, False])
def test_slices_a_quarter_of_a_wavelength_apart_tell_no_sign(made):
    """That of images made here is known."""
    sines = np.sin(np.radians((4, -6)))
    normal = np.array([*sines, np.sqrt(1 - sines @ sines)])
    steps = 6 * np.pi / WAVENUMBER / normal[2]
    grid = ms.VoxelGrid(x=GRID.x, y=GRID.y, z=CENTRE[2] + steps * np.arange(-12, 20))
    metadata = {"history": [{"step": "form_image", "frequency": 79e9}]} if made else {}
    image = ms.SarImage(grid=grid, values=flat((0.08, 0.05), CENTRE, (4, -6), 30, grid=grid).values, metadata=metadata)
    found = of(image)
    assert len(found) == made
    for one in found:
        assert degrees(one.normal, normal) < 0.1


def test_a_plane_does_not_bend():
    (found,) = of(flat((0.08, 0.05), CENTRE, (4, -6), 30))
    assert abs(found.bends_deg).max() < 0.3
    assert "degrees along" not in str(found)


def test_phases_of_either_sign_tell_the_same():
    image = flat((0.08, 0.05), CENTRE, (4, -6), 30)
    (one,), (other,) = of(image), of(ms.SarImage(grid=image.grid, values=np.conj(image.values)))
    np.testing.assert_allclose(one.normal, other.normal, atol=1e-9)
    np.testing.assert_allclose(one.centre, other.centre, atol=1e-9)


def test_steps_and_holes_are_no_hindrance():
    """A lid of 20 x 20 mm, 3 mm higher, and a hole beside it."""
    image = flat((0.09, 0.06), CENTRE)
    higher = flat((0.02, 0.02), (0.03, -0.02, -0.057))
    x, y = (axis - at for axis, at in zip((GRID.x[:, None], GRID.y), CENTRE[:2], strict=True))
    values = np.where(((abs(x - 0.02) <= 0.01) & (abs(y) <= 0.01))[..., None], higher.values, image.values)
    values = values * (np.hypot(x + 0.02, y) > 0.006)[..., None]
    stepped = ms.SarImage(grid=GRID, values=values)
    (found,) = find_flat(lit(image, HALF), stepped)
    assert found.kind == "rectangle"
    assert found.sides == pytest.approx([0.09, 0.06], abs=0.003)
    assert degrees(found.normal, [0, 0, 1]) < 0.3


def test_what_is_round_narrow_or_noise_is_not_flat():
    noise = np.random.default_rng(0).standard_normal((*GRID.shape, 2)) @ [1, 1j]
    x = GRID.x - CENTRE[0]
    bent = flat((0.08, 0.08), CENTRE).values * np.exp(1j * 2500 * x**2 / 0.1)[:, None, None]
    strange = flat((0.08, 0.08), CENTRE).values * ((x[:, None] < 0) | (GRID.y < CENTRE[1]))[..., None]
    images = (
        ball(0.05, CENTRE), cylinder(0.03, -0.06, 0.1), flat((0.08, 0.012), CENTRE),
        *(ms.SarImage(grid=GRID, values=values) for values in (noise, bent, strange)),
    )  # fmt: skip
    for image in images:
        assert of(image) == ()


def test_each_part_is_looked_at_alone_and_small_ones_are_not():
    one, other = flat((0.05, 0.04), (-0.05, -0.05, -0.06), (3, 0)), flat((0.05, 0.04), (0.05, 0.06, -0.02), (0, 6), 90)
    both = ms.SarImage(grid=GRID, values=one.values + other.values)
    mask = lit(both, HALF)
    mask.inside.flags.writeable = True
    mask.inside[:2, :2] = True
    found = find_flat(mask, both)
    assert [round(place.centre[2], 3) for place in found] == pytest.approx([-0.06, -0.02], abs=0.001)
    assert not (found[0].inside & found[1].inside).any()


@pytest.mark.parametrize("axis", [0, 1])
def test_a_row_of_pixels_is_no_top(axis):
    image = flat((0.0025, 0.08) if axis == 0 else (0.08, 0.0025), CENTRE)
    inside = np.zeros(GRID.xy.shape, bool)
    row = abs((GRID.x, GRID.y)[axis] - CENTRE[axis]).argmin()
    inside[(row, slice(20, 60)) if axis == 0 else (slice(20, 60), row)] = True
    assert find_flat(ms.Mask(grid_xy=GRID.xy, inside=inside), image) == ()


def test_where_phases_tell_nothing_nothing_is_flat():
    image = flat((0.08, 0.05), CENTRE)
    mask = lit(image, HALF)
    assert find_flat(mask, ms.SarImage(grid=GRID, values=image.magnitude)) == ()
    assert find_flat(ms.Mask(grid_xy=mask.grid_xy, inside=np.zeros_like(mask.inside)), image) == ()
    everywhere = np.exp(-1j * np.arange(len(GRID.z))) * (image.magnitude.max(axis=2))[..., None]
    assert find_flat(mask, ms.SarImage(grid=GRID, values=everywhere)) == ()
    coarse = ms.VoxelGrid.regular((-0.1, -0.12, -0.1), (0.1, 0.12, 0.06), (0.005, 0.005, 0.01))
    image = flat((0.08, 0.05), CENTRE, grid=coarse)
    assert find_flat(lit(image, HALF), image) == ()


def test_magnitudes_tell_nothing_although_their_history_says_how_they_were_made():
    image = flat((0.08, 0.05), CENTRE, (4, 0))
    made = {"history": [{"step": "form_image", "frequency": 79e9}]}
    assert find_flat(lit(image, HALF), ms.SarImage(grid=GRID, values=image.values, metadata=made))
    real = ms.SarImage(grid=GRID, values=image.magnitude, metadata=made)
    assert find_flat(lit(image, HALF), real) == ()
    assert why_no_forms(real) == "it has magnitudes alone, and no phases"
    assert not why_no_forms(image)
    coarse = ms.SarImage.from_array(image.values, (0.004, 0.004, 0.01))
    assert why_no_forms(coarse).startswith("its pixels of 4 mm are too coarse; form it with 3.")


def seen(image, above=None, below=None):
    """The same image by antennas so far above or below its middle [m]; from below it is mirrored in z."""
    metadata = {"history": [{"step": "form_image", "frequency": 79e9, "antennas": 2 * [[0.0, 0.0, above or -below]]}]}
    if above is not None:
        return ms.SarImage(grid=image.grid, values=image.values, metadata=metadata)
    grid = ms.VoxelGrid(x=image.grid.x, y=image.grid.y, z=-image.grid.z[::-1])
    return ms.SarImage(grid=grid, values=image.values[..., ::-1], metadata=metadata)


def test_antennas_below_see_the_mirror_image():
    image = flat((0.08, 0.05), CENTRE, (4, -6), 30)
    (one,), (other,) = (
        find_flat(lit(which, HALF), which) for which in (seen(image, above=0.2), seen(image, below=0.2))
    )
    mirror = [1, 1, -1]
    for name in ("centre", "normal", "axis"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name) * mirror, atol=1e-6)
    assert other.normal[2] < 0  # towards the antennas
    assert other.tilt_deg == pytest.approx(one.tilt_deg)
    np.testing.assert_allclose(other.curvatures, one.curvatures, atol=1e-6)
    image = ball(0.03, (0.01, -0.02, -0.06))
    (one,), (other,) = (
        find_round(lit(which), which) for which in (seen(image, above=0.2), seen(image, below=0.2))
    )  # fmt: skip
    assert other.radius == pytest.approx(one.radius)
    np.testing.assert_allclose(other.centre, one.centre * mirror, atol=1e-6)


def test_heights_do_not_depend_on_where_the_slices_lie():
    heights = []
    for low in (-0.09, -0.088, -0.086, -0.083):
        grid = ms.VoxelGrid.regular((-0.06, -0.06, low), (0.06, 0.04, low + 0.14), (0.0025, 0.0025, 0.004))
        image = flat((0.08, 0.05), CENTRE, grid=grid)
        wobble = 1 + 0.003 * np.sin(np.arange(len(grid.z)) * 2.4)  # as much as an image's error
        (found,) = of(ms.SarImage(grid=grid, values=image.values * wobble))
        heights.append(found.centre[2])
    assert np.ptp(heights) < 3e-4


def test_a_top_that_goes_on_beyond_its_mask_or_the_picture():
    image = flat((0.14, 0.12), (0, 0, -0.06))
    x, y = GRID.x[:, None], GRID.y
    disc = ms.Mask(grid_xy=GRID.xy, inside=np.hypot(x, y) < 0.025)
    assert find_flat(disc, image) == ()  # a table's, and not that of what lies there
    (whole,) = of(image)
    assert not whole.cut
    cut = ms.VoxelGrid(x=GRID.x[GRID.x > -0.03], y=GRID.y, z=GRID.z)
    (found,) = of(ms.SarImage(grid=cut, values=image.values[GRID.x > -0.03]))
    assert found.cut
    assert found.plain["cut"]
    assert "it reaches the picture's edge" in str(found)


def test_a_hole_in_what_was_taken_off_is_no_top():
    table, shadow = flat((0.16, 0.2), (0, 0, -0.06)), flat((0.05, 0.05), (0, 0, -0.06), kind="ellipse")
    seen_first = ms.SarImage(grid=GRID, values=table.values - shadow.values)
    mask = lit(shadow, HALF)
    assert find_flat(mask, seen_first, covered=True) == ()
    without = remove_sheets(seen_first, frequency=79e9, clutter="lid").result
    assert find_flat(mask, without)  # as bright as a top, where nothing tells what was before


def test_records_of_forms_are_not_to_be_changed():
    (found,) = of(flat((0.08, 0.05), CENTRE))
    assert found == found
    assert {found: 1}[found] == 1
    with pytest.raises(ValueError, match="read-only"):
        found.centre[0] = 1.0


def test_a_mask_of_another_image_is_refused():
    image = flat((0.08, 0.05), CENTRE)
    other = ms.VoxelGrid.regular((-0.1, -0.1, -0.1), (0.1, 0.1, 0.06), (0.0025, 0.0025, 0.01))
    with pytest.raises(InputError, match="mask"):
        find_flat(lit(flat((0.08, 0.05), CENTRE, grid=other)), image)
