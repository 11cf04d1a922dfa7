"""Round trips: a simulated capture, written in each form that a description knows, is read back to the same image."""

import re
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers.commands import run_here
from helpers.oracles import C, point_frames, relative, shared, snell
from helpers.raw_scenes import pcap_of
from millisight.calibration import read_capture
from millisight.io.raw import RAW_FORMATS, RawArray, RawFormat, write_dca1000

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "captures"
POINTS = np.array([[0.03, -0.02, 0.01], [-0.04, 0.03, -0.02], [0.0, 0.05, 0.0]])
AMPLITUDES = np.array([1.0, 0.8j, -0.6])
START, STEP, COUNT = 20e9, 100e6, 41
FREQUENCIES = START + STEP * np.arange(COUNT)
GRID = ms.VoxelGrid.regular((-0.06, -0.06, -0.03), (0.06, 0.06, 0.03), 0.01)
RADAR = f"[radar]\nstart_frequency = {START}\nstep = {STEP}\n"


def written(folder, text):
    (folder / "scan.toml").write_text(text, encoding="utf-8")
    return folder / "scan.toml"


def frames_at(tx, rx=None, offset=0.0, frequencies=FREQUENCIES):
    """(P, T, R, N) frames of the points; antennas (P, A, 3)."""
    return point_frames(POINTS, AMPLITUDES, tx, tx if rx is None else rx, frequencies, offset)


def image_of(frames, tx, rx=None, offset=0.0, frequencies=FREQUENCIES):
    """The image of frames (P, T, R, N), by a sum that is written out here."""
    rx = tx if rx is None else rx
    to, back = (np.linalg.norm(GRID.points[:, None, None] - a, axis=-1) for a in (tx, rx))
    total = np.zeros(GRID.size, dtype=complex)
    for number, frequency in enumerate(frequencies):
        turns = np.exp(2j * np.pi * frequency / C * (to[..., :, None] + back[..., None, :] + offset))
        total += (turns * frames[..., number]).sum(axis=(1, 2, 3))
    return (total / frames.size).reshape(GRID.shape)


def same_image(capture, expected, tolerance=1e-5):
    image = ms.form_image(capture, GRID, method="exact")
    assert relative(image.values, expected) < tolerance


def plane(count=9, step=0.02, z=0.3):
    """(P, 1, 3) a raster of count x count places above the points."""
    line = step * (np.arange(count) - (count - 1) / 2)
    return np.array([[[x, y, z]] for x in line for y in line])


def ring(angles, radius=0.4, height=0.1):
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), height + 0 * angles], axis=-1)[:, None]


PLANE_TEXT = '[positions]\npoints = { file = "points.npy" }\n'


def save_plane(folder, **settings):
    tx = plane(**settings)
    np.save(folder / "points.npy", tx[:, 0])
    return tx, frames_at(tx)


# Circles and turntables


CIRCLE = '[frames]\nfile = "f.npy"\naxes = ["angle", "sample"]\nphase_sign = -1\n[positions]\ncircle = {CIRCLE}\n'


@pytest.mark.slow
def test_circle_by_step_and_by_angles_in_degrees_and_radians(tmp_path):
    angles = np.radians(10 + 6.0 * np.arange(60))
    tx = ring(angles)
    frames = frames_at(tx)
    np.save(tmp_path / "f.npy", frames[:, 0, 0])
    np.savez(tmp_path / "a.npz", deg=np.degrees(angles), rad=angles)
    expected = image_of(frames, tx)
    for how in (
        'step = 6, start = 10, unit = "deg"', 'angles = { file = "a.npz", array = "deg", unit = "deg" }',
        'angles = { file = "a.npz", array = "deg" }, unit = "deg"', 'angles = { file = "a.npz", array = "rad" }',
    ):  # fmt: skip
        circle = f"{{ radius = 0.4, height = 0.1, {how} }}"
        capture = read_capture(written(tmp_path, RADAR + CIRCLE.replace("{CIRCLE}", circle)))
        same_image(capture, expected)
        assert np.allclose(capture.trajectory.positions, tx[:, 0])


def test_a_turntable_turns_the_object_and_counts_ranges_from_its_axis(tmp_path):
    """The object turns by +a before a radar that stays: the radar is at -a in the object's frame."""
    angles = np.radians(4.0 * np.arange(90))
    turned = np.stack(
        [
            point_frames(POINTS @ rotation(a).T, AMPLITUDES, *[np.array([[[0.6, 0, 0]]])] * 2, FREQUENCIES, -1.2)[
                0, 0, 0
            ]
            for a in angles
        ]
    )
    np.save(tmp_path / "f.npy", turned)
    circle = '{ radius = 0.6, step = 4, unit = "deg", turns = "object", range_from = "axis" }'
    capture = read_capture(written(tmp_path, RADAR + CIRCLE.replace("{CIRCLE}", circle)))
    assert capture.radar.path_offset == pytest.approx(-1.2)
    same_image(capture, image_of(turned[:, None, None], ring(-angles, 0.6, 0), offset=-1.2))
    place = POINTS[0]
    near = ms.form_image(capture, ms.VoxelGrid.regular(place - 0.012, place + 0.012, 0.004), method="exact")
    assert np.abs(near.peak[:2] - place[:2]).max() < 0.005


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_a_far_field_is_a_plane_wave(tmp_path):
    angles = np.radians(4.0 * np.arange(90))
    away = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    d = -2 * POINTS @ away.T  # (V, P) path lengths counted from the axis
    frames = np.einsum("v,vpf->pf", AMPLITUDES, np.exp(-2j * np.pi * d[..., None] * FREQUENCIES / C))
    np.save(tmp_path / "f.npy", frames)
    circle = '{ far_field = true, step = 4, unit = "deg" }'
    capture = read_capture(written(tmp_path, RADAR + CIRCLE.replace("{CIRCLE}", circle)))
    d = -2 * GRID.points @ away.T
    expected = np.einsum("pf,vpf->v", frames, np.exp(2j * np.pi * d[..., None] * FREQUENCIES / C)) / frames.size
    same_image(capture, expected.reshape(GRID.shape), 1e-3)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_cylinder_of_angles_and_heights_about_any_axis(tmp_path, axis):
    angles, heights = np.radians(12.0 * np.arange(30)), np.array([-0.05, 0.0, 0.08])
    places = np.array([ring(angles, 0.4, h)[:, 0] for h in heights]).reshape(-1, 1, 3)  # heights are the slow axis
    places = np.roll(places, "xyz".index(axis) - 2, axis=-1) + np.array([0.01, 0.0, 0.02])
    frames = frames_at(places)
    np.save(tmp_path / "f.npy", frames.reshape(3, 30, COUNT))
    text = f"{{ radius = 0.4, height = [-0.05, 0.0, 0.08], step = 12, unit = 'deg', axis = '{axis}', "
    text += "center = [0.01, 0, 0.02] }"
    text = RADAR + CIRCLE.replace("{CIRCLE}", text).replace('["angle"', '["height", "angle"')
    same_image(read_capture(written(tmp_path, text)), image_of(frames, places))


def test_antennas_turn_with_the_radar_on_a_circle(tmp_path):
    angles = np.radians(6.0 * np.arange(60))
    turned = np.array([[p[0] + rotation(a) @ [0.0, 0.03, 0.01]] for p, a in zip(ring(angles), angles, strict=True)])
    frames = frames_at(ring(angles), turned)
    np.save(tmp_path / "f.npy", frames[:, 0, 0])
    circle = '{ radius = 0.4, height = 0.1, step = 6, unit = "deg" }'
    text = RADAR + "rx_positions = [[0, 0.03, 0.01]]\n" + CIRCLE.replace("{CIRCLE}", circle)
    same_image(read_capture(written(tmp_path, text)), image_of(frames, ring(angles), turned))


@pytest.mark.parametrize(
    ("circle", "message"),
    [
        ("{ step = 6 }", r"\[positions\] circle has no radius; expected .*far_field"),
        ("{ radius = 1, far_field = true, step = 6 }", "radius is '1'.*either the antenna's distance"),
        (
            "{ radius = 1, step = 6 }",
            r"has no unit; expected .*in radians the angles go 56.34 times round",
        ),
        ('{ radius = 1, step = 6, unit = "degrees" }', "unit in .*'degrees'. Did you mean 'deg'"),
        (
            "{ radius = 1, angles = [0, 1, 2] }",
            "expected 60 angles, as many as there are frames on the circle, and not 3",
        ),
        ("{ radius = 1, angles = [0, 1], step = 1 }", "has angles and step"),
        ("{ radius = -1, step = 0.1 }", "radius is '-1'; expected more than 0"),
        ("{ radius = 1, step = 0.1, height = [1, 2] }", "height is .*one number or 60"),
        ('{ radius = 1, step = 0.1, axis = "w" }', "axis in .*'w'"),
        ('{ radius = 1, step = 0.1, axes = "z" }', "key in .*circle: 'axes'. Did you mean 'axis'"),
        ('{ far_field = true, step = 0.1, range_from = "antenna" }', "ranges cannot be counted from an antenna"),
        ("{ far_field = true, step = 0.1, height = 1 }", "none in a far field"),
    ],
)
def test_what_is_wrong_with_a_circle_is_told(tmp_path, circle, message):
    np.save(tmp_path / "f.npy", np.ones((60, COUNT), complex))
    with pytest.raises(ms.errors.MillisightError, match=message):
        read_capture(written(tmp_path, RADAR + CIRCLE.replace("{CIRCLE}", circle)))


# Antennas at each pose, and measured pairs


@pytest.mark.slow
def test_antennas_for_each_pose(tmp_path):
    rng = np.random.default_rng(1)
    tx, rx = (rng.uniform(-0.1, 0.1, (30, count, 3)) + np.array([0, 0, 0.3]) for count in (2, 3))
    frames = frames_at(tx, rx)
    np.savez(tmp_path / "f.npz", data=frames, tx=1e3 * tx, rx=rx)
    text = RADAR + '[frames]\nfile = "f.npz"\narray = "data"\naxes = ["pose", "tx", "rx", "sample"]\nphase_sign = -1\n'
    text += '[positions]\ntx_points = { array = "tx", unit = "mm" }\nrx_points = { array = "rx" }\n'
    capture = read_capture(written(tmp_path, text))
    assert np.allclose(capture.tx_positions, tx)
    assert np.array_equal(capture.rx_positions, rx)
    same_image(capture, image_of(frames, tx, rx))
    for old, new, message in (
        (
            'rx_points = { array = "rx" }\n',
            "",
            r"has no rx_points; expected both of tx_points and rx_points, or raster",
        ),
        ('array = "rx"', 'array = "tx"', r"rx_points is .*\(30, 3, 3\), each antenna .*; its shape is \(30, 2, 3\)"),
        ("tx_points =", "tx_point =", "'tx_point'. Did you mean 'tx_points'"),
        ('unit = "mm"', 'unit = "mil"', r"tx_points: 'mil'"),
        ("[radar]", "[radar]\ntx_positions = [[0, 0, 0]]", r"tx_positions is .*only in \[positions\]"),
    ):
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(written(tmp_path, text.replace(old, new)))
    # Saved and loaded, and with noise or a step of calibration, they are where they were.
    ms.save(tmp_path / "c.h5", capture)
    with ms.open_capture(tmp_path / "c.h5") as opened:
        same_image(opened, image_of(frames, tx, rx))
    assert np.array_equal(ms.add_noise(capture, snr_db=20, rng=0).rx_points, capture.rx_points)
    assert np.array_equal(ms.calibration.subtract_mean(capture).tx_points, capture.tx_points)
    # A transmitter that stays, and a receiver that is moved on a raster.
    still, moved = np.array([[0.0, 0.1, 0.4]]), plane()
    one = frames_at(np.broadcast_to(still, (81, 1, 3)), moved)
    np.savez(tmp_path / "f.npz", data=one)
    text = text.split("[positions]")[0] + "[positions]\ntx_points = [[0.0, 0.1, 0.4]]\n"
    text += "raster = { step = 0.02, counts = [9, 9], center = [0, 0, 0.3] }\n"
    same_image(read_capture(written(tmp_path, text)), image_of(one, np.broadcast_to(still, (81, 1, 3)), moved))


def ring_of_pairs():
    antennas = np.concatenate([ring(np.radians(30.0 * np.arange(12)), 0.3, h)[:, 0] for h in (0.0, 0.1)])
    pairs = np.array([(a, b) for a in range(24) for b in range(a + 1, 24)])
    tx, rx = antennas[pairs[:, 0], None], antennas[pairs[:, 1], None]
    return antennas, pairs, tx, rx


PAIRS = """
[frames]
file = "f.csv"
axes = ["sample", "pair"]
phase_sign = 1
[positions]
tx_points = { file = "antennas.csv", unit = "mm" }
pairs = { file = "pairs.csv" }
count_from = 1
"""


@pytest.mark.slow
def test_measured_pairs_in_texts(tmp_path):
    antennas, pairs, tx, rx = ring_of_pairs()
    frames = frames_at(tx, rx)
    rows = frames[:, 0, 0].conj().T
    lines = [",".join(f"{v.real:.9g}{v.imag:+.9g}i" for v in row) for row in rows]
    (tmp_path / "f.csv").write_text("\n".join(lines))
    np.savetxt(tmp_path / "antennas.csv", 1e3 * antennas, delimiter=",")
    np.savetxt(tmp_path / "pairs.csv", pairs + 1, fmt="%d", delimiter=",")
    capture = read_capture(written(tmp_path, RADAR + PAIRS))
    assert capture.frames.shape == (276, 1, 1, COUNT)
    same_image(capture, image_of(frames, tx, rx))
    for old, new, message in (
        ("count_from = 1\n", "", r"\[positions\] has no count_from; expected 0 or 1, .* no pair has the number 0"),
        ("count_from = 1", "count_from = 0", "from 0 to 23, of the 24 antennas, and they go from 2 to 24"),
        ("pairs =", "tx_pairs =", "key in .*'tx_pairs'. Did you mean"),
        ('pairs = { file = "pairs.csv" }\ncount_from = 1\n', "", r"has no pairs; expected the two antennas"),
        ('"pairs.csv"', '"antennas.csv"', "pairs cannot be read as an array of int64"),
        ('pairs = { file = "pairs.csv" }', "pairs = [[1, 2]]", "276 of them, as many .* 'pair'; there are 1"),
        ('pairs = { file = "pairs.csv" }', "pairs = [1, 2]", r"\(pairs, 2\), a transmitter and a receiver"),
        ('"pair"]', '"pair", "tx"]', "a pair is one of each"),
        ('tx_points = { file = "antennas.csv", unit = "mm" }\n', "", "has no tx_points"),
    ):
        assert old in PAIRS
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(written(tmp_path, RADAR + PAIRS.replace(old, new)))


def test_pairs_of_an_array_on_a_turntable(tmp_path):
    """A small array on a circle: each pair at each angle, its antennas turned with it."""
    antennas = np.array([[0, -0.05, 0], [0, 0, 0.0], [0, 0.05, 0], [0, 0, 0.05]])
    pairs = np.array([[0, 1], [2, 1], [3, 0]])
    angles = np.radians(15.0 * np.arange(24))
    placed = np.array([[p[0] + rotation(a) @ q for q in antennas] for p, a in zip(ring(angles), angles, strict=True)])
    tx, rx = (placed[:, pairs[:, i]].reshape(-1, 1, 3) for i in (0, 1))
    frames = frames_at(tx, rx)
    np.savez(tmp_path / "f.npz", data=frames.reshape(24, 3, COUNT).transpose(1, 0, 2), antennas=antennas)
    text = RADAR + '[frames]\nfile = "f.npz"\narray = "data"\naxes = ["pair", "angle", "sample"]\nphase_sign = -1\n'
    text += '[positions]\ncircle = { radius = 0.4, height = 0.1, step = 15, unit = "deg" }\n'
    text += 'tx_points = { array = "antennas" }\npairs = [[0, 1], [2, 1], [3, 0]]\n'
    same_image(read_capture(written(tmp_path, text)), image_of(frames, tx, rx))


# Texts, Touchstone, slices


def rows_of(frames):
    """(P N, 4): pose, frequency in GHz, real, imaginary."""
    pose, sample = np.divmod(np.arange(len(frames) * COUNT), COUNT)
    values = frames[:, 0, 0].ravel()
    return np.stack([pose, FREQUENCIES[sample] / 1e9, values.real, values.imag], axis=-1)


@pytest.mark.parametrize(
    ("decimal", "separator"), [(".", ","), (".", ";"), (",", ";"), (",", "\t"), (",", " "), (".", " ")]
)
def test_an_analysers_own_text(tmp_path, decimal, separator):
    tx, frames = save_plane(tmp_path, count=5, step=0.03)
    lines = ["Analyser XY", '2026, "a; b"', ""]
    for row in rows_of(frames):
        lines.append(separator.join(f"{value:.9e}".replace(".", decimal) for value in row))
    (tmp_path / "f.dat").write_text("\n".join(lines))
    text = '[radar]\nfrequencies = { file = "f.dat", skip_rows = 3, columns = [1], slice = [0, 41], unit = "GHz"%s }\n'
    text += '[frames]\nfile = "f.dat"\nskip_rows = 3\ncolumns = [2, 3]\nshape = [25, 41, 2]\nparts = ["I", "Q"]\n'
    text += 'axes = ["pose", "sample", "part"]\nphase_sign = -1\n%s' + PLANE_TEXT
    told = ('decimal = ","\n', ', decimal = ","') if decimal == "," else ("", "")
    same_image(read_capture(written(tmp_path, text % (told[1], told[0]))), image_of(frames, tx))
    if decimal == ",":
        with pytest.raises(ms.errors.MillisightError, match=r"f.dat, line 4 has '.*set decimal = \",\""):
            read_capture(written(tmp_path, text % (told[1], "")))
    else:
        with pytest.raises(ms.errors.MillisightError, match="f.dat, line . has .*a number cannot contain a point"):
            read_capture(written(tmp_path, text % ("", 'decimal = ","\n')))


@pytest.mark.parametrize(
    ("parts", "turn"),
    [
        ('["dB", "deg"]', lambda v: (20 * np.log10(abs(v)), np.degrees(np.angle(v)))),
        ('["rad", "magnitude"]', lambda v: (np.angle(v), abs(v))),
    ],
)
def test_magnitude_and_phase(tmp_path, parts, turn):
    tx, frames = save_plane(tmp_path, count=5, step=0.03)
    np.save(tmp_path / "f.npy", np.stack(turn(frames[:, 0, 0]), axis=-1))
    text = RADAR + f'[frames]\nfile = "f.npy"\naxes = ["pose", "sample", "part"]\nparts = {parts}\nphase_sign = -1\n'
    same_image(read_capture(written(tmp_path, text + PLANE_TEXT)), image_of(frames, tx))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1,5;2,5\n3,5;4,5\n", r"t.csv, line 1 has '1,5'.*set decimal = \",\""),
        ("1,5 2,5\n3,5 4,5\n", r"t.csv, line 1 has '1,5'.*set decimal = \",\""),
        ("1,5\n3,25\n", r"t.csv, line 2: '3,25' may be 1 numbers with a decimal comma, or 2 whole ones; set decimal"),
        ("1,5,2,5\n3,5,4,5\n", "may be 2 numbers with a decimal comma, or 4 whole ones"),
        ("re\n1,5\n3,25\n", r"line 2 has 2 columns; expected 1 .*decimal commas, set decimal = \",\""),
        ("1.5;2,5\n3;4,5\n", "line 1 has '2,5'"),
        ("1+2i;3-1j\n1+x;2\n", r"line 2 has '1\+x'; expected a finite number"),
        ("a;b\n1;2\n3;4\nEND\n", "t.csv, line 4 has 1 columns; expected 2 as before: 'END'; rows = 2 leaves out what"),
        ("1;2;\n3;;\n", "line 2 has ''"),
        ("1;2;\n3\n", "line 1 has '1;2;'"),
        ("1\x002\n", "bytes that no text has"),
        ("\xb5\n1 2\n3\n", "line 2 has 2 columns; expected 1|line 3 has 1"),
    ],
)
def test_a_decimal_comma_is_never_two_numbers(tmp_path, content, message):
    (tmp_path / "t.csv").write_text(content)
    with pytest.raises(ms.errors.FileError, match=message):
        ms_read(tmp_path / "t.csv")


def ms_read(path, **settings):
    from millisight.io.arrays import read_table

    return read_table(path, **settings)


def test_texts_that_are_plain(tmp_path):
    for content, settings, expected in (
        ("1,5\n3,25\n", {"decimal": "."}, [[1, 5], [3, 25]]), ("1,5\n3,25\n", {"decimal": ","}, [[1.5], [3.25]]),
        ("a,b\n1,5\n3,25\n", {}, [[1, 5], [3, 25]]), ("1, 5\n3, 25\n", {}, [[1, 5], [3, 25]]),
        ("1,2,3\n4,5,6\n", {}, [[1, 2, 3], [4, 5, 6]]),
        ("(1+2j) 3j # a\n\n1.5-2i 4\n", {}, [[1 + 2j, 3j], [1.5 - 2j, 4]]),
        ("0.5 + 2i   -1.5e0 - 0.25i\n", {}, [[0.5 + 2j, -1.5 - 0.25j]]), ("1;2;\n3;4;\n", {}, [[1, 2], [3, 4]]),
        ("! VNA, 1.5\nBEGIN\nf (Hz),dB\n1,2\n3,4\nEND\n5,6\n", {"skip_rows": 2, "rows": 2}, [[1, 2], [3, 4]]),
        ("t;0;1\n1;2;3\n", {}, [[1, 2, 3]]),
        ("1e-3\t-2\n", {}, [[1e-3, -2]]), ("head\nmore, of it\n1;2\n", {"skip_rows": 2}, [[1, 2]]),
    ):  # fmt: skip
        (tmp_path / "t.csv").write_text(content)
        assert np.array_equal(ms_read(tmp_path / "t.csv", **settings).values, expected)
    for encoding in ("latin-1", "utf-8", "utf-8-sig", "utf-16"):
        (tmp_path / "t.csv").write_text("Phase [°];µ\n1;2\n", encoding=encoding)
        assert ms_read(tmp_path / "t.csv").names == ("Phase [°]", "µ")
    (tmp_path / "t.csv").write_text("t,a,b\n1,2,3\n")
    table = ms_read(tmp_path / "t.csv")
    assert np.array_equal(table.columns("1:"), [[2, 3]])
    for wanted in ("a", "3:", [], [0.5], ":1"):
        with pytest.raises(ms.errors.InputError, match=r"columns is .*expected a list of numbers.*t.csv has 3"):
            table.columns(wanted)
    with pytest.raises(ms.errors.FileError, match="t.csv has 1 rows of numbers; expected 5"):
        ms_read(tmp_path / "t.csv", rows=5)


def test_slices_in_references(tmp_path):
    tx, frames = save_plane(tmp_path, count=5, step=0.03)
    fine = START + STEP / 4 * np.arange(-80, 400)
    np.savez(tmp_path / "f.npz", data=frames[:, 0, 0], fine=fine)
    text = '[radar]\nfrequencies = { array = "fine", slice = [80, 244, 4] }\n[frames]\nfile = "f.npz"\narray = "data"\n'
    text += 'axes = ["pose", "sample"]\nphase_sign = -1\n' + PLANE_TEXT
    same_image(read_capture(written(tmp_path, text)), image_of(frames, tx))
    for places, message in (
        ("[80, 481]", r"\[radar\] frequencies: slice is '\[80, 481\]'; expected start below stop, and stop at most"),
        ("[80]", "slice is .*whole numbers from 0"), ("[5, 2]", "start below stop"), ('"80:2"', "slice is '80:2'"),
        ("[80, 240, 4]", "samples .*expected 41 samples as in the frames|41 samples"),
    ):  # fmt: skip
        with pytest.raises(ms.errors.FormatError, match=message):
            read_capture(written(tmp_path, text.replace("[80, 244, 4]", places)))


def touchstone(values, form, unit):
    """A .s2p text with these S21 (N,) and other numbers for the rest."""

    def pair(v):
        if form == "RI":
            return f"{v.real:.12g} {v.imag:.12g}"
        size = abs(v) if form == "MA" else 20 * np.log10(abs(v))
        return f"{size:.12g} {np.degrees(np.angle(v)):.12g}"

    scale = {"Hz": 1, "MHz": 1e6, "GHz": 1e9}[unit]
    lines = ["! made by a test", f"# {unit} S {form} R 50"]
    lines += [
        f"{f / scale:.12g} {pair(0.1)} {pair(v)} {pair(0.2j)} {pair(-0.3)} ! c"
        for f, v in zip(FREQUENCIES, values, strict=True)
    ]
    return "\n".join(lines) + "\n"


def test_touchstone_files_one_a_pose(tmp_path):
    tx, frames = save_plane(tmp_path, count=4, step=0.03)
    for number, values in enumerate(frames[:, 0, 0]):
        form, unit = (("RI", "Hz"), ("MA", "MHz"), ("DB", "GHz"))[number % 3]
        (tmp_path / f"p{number}.s2p").write_text(touchstone(values, form, unit))
    text = '[radar]\nname = "VNA"\n[frames]\nfile = "p*.s2p"\n' + PLANE_TEXT
    same_image(read_capture(written(tmp_path, text)), image_of(frames, tx))
    assert np.allclose(read_capture(tmp_path / "scan.toml").radar.waveform.frequencies, FREQUENCIES)
    german = (tmp_path / "p1.s2p").read_text()
    (tmp_path / "p1.s2p").write_text(german.replace(".", ","))
    same_image(read_capture(tmp_path / "scan.toml"), image_of(frames, tx))
    (tmp_path / "p1.s2p").write_text(german)
    first = (tmp_path / "p0.s2p").read_text()
    for old, new, message in (
        ('"p*.s2p"', '"p*.s2p"\nparameter = "S31"', "parameter is 'S31'; .*p0.s2p has S11, S21, S12, S22"),
        ('"VNA"', '"VNA"\nstep = 1e6', "step is .*the frequencies come from the files"),
    ):
        with pytest.raises(ms.errors.FormatError, match=message):
            read_capture(written(tmp_path, text.replace(old, new)))
    for content, message in (
        (first.replace("S RI", "Z RI"), "p0.s2p, line 2: it holds Z parameters"),
        (first[:-40], "p0.s2p holds .*expected 9"),
        (first.replace("0.1 0", "0.1 x", 1), "p0.s2p, line 3 has 'x'"),
        (first.replace("# Hz", "# kHz"), "same frequencies"),
        (f"# GHz S RI R 50\n1e306{' 0' * 8}\n", "a frequency is beyond all numbers"),
    ):  # fmt: skip
        (tmp_path / "p0.s2p").write_text(content)
        with pytest.raises(ms.errors.FileError, match=message):
            read_capture(written(tmp_path, text))


@pytest.mark.slow
def test_the_page_on_network_analysers_shows_what_works(tmp_path):
    page = (EXAMPLES.parents[1] / "docs" / "how-to" / "vna.md").read_text(encoding="utf-8")
    many, text, calibration = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    line = 0.005 * (np.arange(20) - 9.5)
    tx = np.array([[[x, y, 0]] for x in line for y in line])
    frames = frames_at(tx)
    for number, values in enumerate(frames[:, 0, 0]):
        (tmp_path / f"p{number + 1}.s2p").write_text(touchstone(values, "RI", "GHz"))
    same_image(read_capture(written(tmp_path, many)), image_of(frames, tx))
    head = re.search(r"```text\n(Instrument.*?)20,000;", page, flags=re.DOTALL)[1]
    fine = 20 + 0.025 * np.arange(401)
    field = frames_at(tx[:1], frequencies=1e9 * fine)[0, 0, 0]
    columns = np.stack([fine, 20 * np.log10(abs(field)), np.degrees(np.angle(field))], axis=-1)
    rows = [";".join(f"{v:.9f}".replace(".", ",") for v in row) for row in columns]
    (tmp_path / "p1.csv").write_text(head + "\n".join(rows))
    (tmp_path / "through.s2p").write_text(touchstone(np.full(COUNT, 2j), "RI", "GHz"))
    assert np.allclose(read_capture(written(tmp_path, text)).frames[0, 0, 0], field, atol=1e-5)
    halved = read_capture(written(tmp_path, many + calibration))
    assert np.allclose(halved.frames, frames / 2j, atol=1e-5)


@pytest.mark.parametrize("along", ["part", "sample"])
def test_files_that_are_entries_of_an_axis(tmp_path, along):
    """Real and imaginary parts in two texts; a file for each frequency."""
    tx, frames = save_plane(tmp_path, count=5, step=0.03)
    field = frames[:, 0, 0]
    if along == "part":
        for name, part in (("re", field.real), ("im", field.imag)):
            np.savetxt(tmp_path / f"{name}.csv", part, delimiter=";")
        text = 'file = ["im.csv", "re.csv"]\nparts = ["Q", "I"]\naxes = ["pose", "sample"]\n'
    else:
        for number, column in enumerate(field.T):
            np.save(tmp_path / f"f{number}.npy", column.reshape(5, 5).T)
        text = 'file = "f*.npy"\naxes = ["y", "x"]\n'
    where = PLANE_TEXT if along == "part" else "[positions]\nraster = { step = 0.03, center = [0, 0, 0.3] }\n"
    text = RADAR + f'[frames]\nfiles_along = "{along}"\n{text}phase_sign = -1\n'
    capture = read_capture(written(tmp_path, text + where))
    same_image(capture, image_of(frames, tx))
    np.savetxt(tmp_path / "im.csv", field.imag[:3], delimiter=";")
    np.save(tmp_path / "f3.npy", np.ones((4, 5), complex))
    for old, new, message in (
        (f'"{along}"', '"chirp"', "files_along in .*'chirp'"), (f'files_along = "{along}"\n', "", "files_along"),
        ("files_along", "file_along", "Did you mean 'files_along'"), ("", "", r"whole files of one shape; .* has \("),
        (where, where + '[calibration]\nbackground = "points.npy"\n', "no such key beside another file|whole files"),
    ):  # fmt: skip
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(written(tmp_path, (text + where).replace(old, new, 1)))


# Calibration, media, layers


def test_reference_spectra_of_one_antenna_count_twice(tmp_path):
    tx, frames = save_plane(tmp_path, count=5, step=0.03)
    antenna = (1 + 0.3 * np.linspace(-1, 1, COUNT)) * np.exp(1j * np.linspace(0, 5, COUNT))
    np.savez(tmp_path / "f.npz", data=(frames[:, 0, 0] * antenna**2).conj(), antenna=antenna.conj()[:, None])
    text = RADAR + '[frames]\nfile = "f.npz"\narray = "data"\naxes = ["pose", "sample"]\nphase_sign = 1\n' + PLANE_TEXT
    whole = text + '[calibration]\nreference = { array = "antenna", power = 2 }\n'
    same_image(read_capture(written(tmp_path, whole)), image_of(frames, tx), 1e-4)
    np.savez(tmp_path / "r.npz", good=antenna, short=antenna[:5], zero=0 * antenna)
    for old, new, message in (
        ('array = "antenna"', 'file = "r.npz", array = "short"', r"\[calibration\]: reference has shape \(5,\)"),
        ('array = "antenna"', 'file = "r.npz", array = "zero"', r"\[calibration\]: reference is 0 at \(0,\)"),
        ("power", "powers", "'powers'. Did you mean 'power'"),
    ):
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(written(tmp_path, whole.replace(old, new)))


def test_a_homogeneous_medium(tmp_path):
    tx, _ = save_plane(tmp_path, count=5, step=0.03)
    frames = point_frames(POINTS, AMPLITUDES, tx, tx, FREQUENCIES * np.sqrt(2.5), 0.2 / np.sqrt(2.5))
    np.save(tmp_path / "f.npy", frames[:, 0, 0])
    text = (
        RADAR + 'path_offset = 0.2\n[frames]\nfile = "f.npy"\naxes = ["pose", "sample"]\nphase_sign = -1\n' + PLANE_TEXT
    )
    capture = read_capture(written(tmp_path, text + "[medium]\npermittivity = 2.5\n"))
    same_image(capture, image_of(frames, tx, offset=0.2 / np.sqrt(2.5), frequencies=FREQUENCIES * np.sqrt(2.5)))
    assert capture.metadata["history"][-1]["step"] == "set_medium"
    for medium, message in (
        ("permittivity = -1", r"\[medium\]: permittivity is -1; expected more than 0"), ("", "has no permittivity"),
        ("permitivity = 2", "Did you mean 'permittivity'"), ('permittivity = 2\ntowards = "z"', "only beside layers"),
    ):  # fmt: skip
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(written(tmp_path, text + f"[medium]\n{medium}\n"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("layers", "index"),
    [
        ([(0.02, 2.6)], 1.0), ([(0.004, 3.0), (0.05, 1.1), (0.004, 3.0)], 1.0), ([(0.06, 1.0)], np.sqrt(2.2)),
        ([(0.2, 4.0)], 1.0),
    ],
)  # fmt: skip
def test_layers_are_seen_through_by_snells_law(tmp_path, layers, index):
    """Walls, a carton's, a scene inside a block below air, a thick wall; without the layers the image is another."""
    tx, _ = save_plane(tmp_path, count=13, step=0.04, z=0.35)
    d = 2 * snell(POINTS, tx[:, 0], layers, index)
    frames = np.einsum("v,pvf->pf", AMPLITUDES, np.exp(-2j * np.pi * d[..., None] * FREQUENCIES / C))
    np.save(tmp_path / "f.npy", frames)
    text = RADAR + '[frames]\nfile = "f.npy"\naxes = ["pose", "sample"]\nphase_sign = -1\n' + PLANE_TEXT + "[medium]\n"
    listed = ", ".join(f"{{ thickness = {t}, permittivity = {e} }}" for t, e in layers)
    capture = read_capture(written(tmp_path, text + f"permittivity = {index**2}\nlayers = [{listed}]\n"))
    assert capture.metadata["history"][-1]["step"] == "see_through"
    # The exact image: its sum over the paths by Snell's law.
    d = 2 * snell(GRID.points, tx[:, 0], layers, index)
    exact = np.zeros(GRID.size, complex)
    for f, column in zip(FREQUENCIES, frames.T, strict=True):
        exact += np.exp(2j * np.pi * f * d.T / C) @ column
    exact = (exact / frames.size).reshape(GRID.shape)
    same_image(capture, exact)
    assert relative(ms.form_image(capture, GRID, method="backprojection").values, exact) < 0.005
    plain = read_capture(written(tmp_path, text + f"permittivity = {index**2}\n")) if index > 1 else None
    plain = plain or read_capture(written(tmp_path, text.removesuffix("[medium]\n")))
    assert relative(ms.form_image(plain, GRID, method="exact").values, exact) > 0.5


def test_what_is_wrong_with_layers_is_told(tmp_path):
    _, frames = save_plane(tmp_path, count=5, step=0.05)
    np.save(tmp_path / "f.npy", frames[:, 0, 0])
    text = RADAR + '[frames]\nfile = "f.npy"\naxes = ["pose", "sample"]\nphase_sign = -1\n' + PLANE_TEXT
    medium = "[medium]\nlayers = [{ thickness = 0.2, permittivity = 4 }]\nmax_angle = 1.2\n"
    upside_down = read_capture(written(tmp_path, text + medium + 'towards = "z"\n'))
    with pytest.raises(ms.errors.InputError, match=r"the grid begins -0.33 m from .* along \[0.0, 0.0, 1.0\]"):
        ms.form_image(upside_down, GRID)
    with pytest.raises(ms.errors.InputError, match="layers are 0.4 m thick; expected a grid behind them"):
        ms.form_image(read_capture(written(tmp_path, text + medium.replace("0.2", "0.4"))), GRID)
    with pytest.raises(ms.errors.InputError, match="a twentieth of the wavelength; use another method"):
        ms.form_image(read_capture(written(tmp_path, text + medium)), GRID, method="sparse")
    for old, new, message in (
        ("thickness = 0.2, ", "", r"\[medium\] layers 0 has no thickness"),
        ("0.2", "-0.2", r"\[medium\]: a layer is -0.2"),
        ("max_angle = 1.2", 'towards = "down"', "towards in .*'down'"),
        ("thickness", "thicknes", "Did you mean 'thickness'"),
        ("[{", "{", "layers is|expected a list|not a description"),
    ):  # fmt: skip
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(written(tmp_path, text + medium.replace(old, new)))


# Time, one way, chirps, receivers, packets


def test_range_profiles(tmp_path):
    tx, frames = save_plane(tmp_path, count=5, step=0.03)
    many = 128
    profiles = np.fft.ifft(frames[:, 0, 0], many, axis=-1)
    spacing = C / (2 * many * STEP)
    first = 7  # profiles that begin at a range of their own
    np.save(tmp_path / "f.npy", np.roll(profiles, -first, axis=-1).conj())
    text = f"[radar]\nstart_frequency = {START}\nstop_frequency = {START + STEP * (COUNT - 1)}\n"
    text += f'[frames]\nfile = "f.npy"\naxes = ["pose", "sample"]\nphase_sign = 1\ndomain = "time"\ncarrier = {START}\n'
    text += f"range_start = {first * spacing!r}\nrange_step = {spacing!r}\n" + PLANE_TEXT
    capture = read_capture(written(tmp_path, text))
    assert np.allclose(capture.radar.waveform.frequencies, FREQUENCIES)
    same_image(capture, image_of(frames, tx), 1e-4)


def test_pulses(tmp_path):
    """Real samples of a pulse of 2 to 6 GHz, as an oscilloscope has them."""
    frequencies = 2e9 + 50e6 * np.arange(81)
    tx = plane(count=5, step=0.03)
    np.save(tmp_path / "points.npy", tx[:, 0])
    frames = frames_at(tx, frequencies=frequencies)
    count, step = 800, 1 / (800 * 50e6)
    times = 1e-9 + step * np.arange(count)
    pulses = np.real(frames[:, 0, 0] @ np.exp(2j * np.pi * frequencies[:, None] * times)) / count
    np.save(tmp_path / "f.npy", pulses)
    text = '[radar]\nstart_frequency = 2e9\nstop_frequency = 6e9\n[frames]\nfile = "f.npy"\naxes = ["pose", "sample"]\n'
    text += f'domain = "time"\ntime_start = 1e-9\ntime_step = {step!r}\n' + PLANE_TEXT
    capture = read_capture(written(tmp_path, text))
    assert np.allclose(capture.radar.waveform.frequencies, frequencies)
    same_image(capture, image_of(frames, tx, frequencies=frequencies), 1e-4)
    lines = ["t [ns];" + ";".join(f"CH{i}" for i in range(25)) + ";"]
    lines += [";".join(f"{v:.9g}" for v in row) + ";" for row in np.column_stack([times, pulses.T])]
    (tmp_path / "scope.csv").write_text("\n".join(lines))
    traces = text.replace("f.npy", 'scope.csv"\ncolumns = "1:').replace('["pose", "sample"]', '["sample", "pose"]')
    same_image(read_capture(written(tmp_path, traces)), image_of(frames, tx, frequencies=frequencies), 1e-4)
    for old, new, message in (
        ("stop_frequency = 6e9\n", "", r"\[radar\] has no stop_frequency; expected .*the band of the pulse"),
        ("stop_frequency = 6e9", "stop_frequency = 60e9", "stop_frequency is .*up to 2e.10 Hz, which samples"),
        ("time_step =", "range_start = 1\ntime_step =", "range_start is"),
        ('domain = "time"\n', "", "with domain = \"time\""),
        (f"time_step = {step!r}\n", "", "has none of time_step, range_step"),
        ('"time"', '"times"', "Did you mean 'time'"),
        ("[frames]\n", "[frames]\ncarrier = 1e9\n", "carrier is .*only for complex samples"),
    ):  # fmt: skip
        assert old in text
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(written(tmp_path, text.replace(old, new)))


def test_one_way(tmp_path):
    tx, _ = save_plane(tmp_path, count=5, step=0.03)
    rx = tx + np.array([[0.01, 0, 0], [0.0, 0.02, 0]])
    d = np.linalg.norm(POINTS - rx[:, :, None], axis=-1) + 0.1
    frames = np.einsum("v,prvf->prf", AMPLITUDES, np.exp(-2j * np.pi * d[..., None] * FREQUENCIES / C))
    np.save(tmp_path / "f.npy", frames)
    text = RADAR + "path_offset = 0.1\nrx_positions = [[0.01, 0, 0], [0, 0.02, 0]]\n"
    text += '[frames]\nfile = "f.npy"\naxes = ["pose", "rx", "sample"]\nphase_sign = -1\none_way = true\n' + PLANE_TEXT
    d = np.linalg.norm(GRID.points - rx[:, :, None], axis=-1) + 0.1
    expected = np.einsum("prf,prvf->v", frames, np.exp(2j * np.pi * d[..., None] * FREQUENCIES / C)) / frames.size
    capture = read_capture(written(tmp_path, text))
    assert capture.frames.shape == (50, 1, 1, COUNT)
    same_image(capture, expected.reshape(GRID.shape))
    with pytest.raises(ms.errors.FormatError, match="one_way is '1'; expected true or false"):
        read_capture(written(tmp_path, text.replace("true", "1")))
    np.save(tmp_path / "f.npy", frames[:, :1])
    one = text.replace("[[0.01, 0, 0], [0, 0.02, 0]]", "[[0.01, 0, 0]]")
    values = np.einsum("prf,prvf->v", frames[:, :1], np.exp(2j * np.pi * d[:, :1, :, None] * FREQUENCIES / C))
    same_image(read_capture(written(tmp_path, one)), values.reshape(GRID.shape) / frames[:, :1].size)


def test_adc_start_and_receivers_by_number(tmp_path):
    tx, _ = save_plane(tmp_path, count=5, step=0.03)
    offsets = np.array([[0.01 * i, 0, 0] for i in range(4)])
    slope, rate, delay = 50e12, 5e6, 6e-6
    frequencies = 19.7e9 + slope * (delay + np.arange(32) / rate)
    frames = point_frames(POINTS, AMPLITUDES, tx, tx + offsets, frequencies)
    counts = np.round(2000 * frames).conj()
    write_dca1000(tmp_path / "f.bin", counts, order="two-lane")
    text = f"[radar]\nstart_frequency = 19.7e9\nslope = {slope}\nsample_rate = {rate}\nadc_start = {delay}\n"
    text += f"rx_positions = {offsets.tolist()}\n"
    text += '[frames]\nfile = "f.bin"\nsamples = 32\norder = "two-lane"\nphase_sign = 1\nuse_receivers = [3, 1]\n'
    capture = read_capture(written(tmp_path, text + PLANE_TEXT))
    assert "2 of 4 recorded receivers are read: 3, 1" in capture.metadata["notes"][-1]
    chosen = counts.conj()[:, :, [3, 1]]
    expected = image_of(chosen, tx, tx + offsets[[3, 1]], frequencies=frequencies)
    same_image(capture, expected)
    few = text.replace(str(offsets.tolist()), str(offsets[[3, 1]].tolist()))
    same_image(read_capture(written(tmp_path, few + PLANE_TEXT)), expected)
    for old, new, message in (
        ("[3, 1]", "[4]", "use_receivers is .*numbers below 4, the receivers in .*f.bin"),
        ("[3, 1]", "[1, 1]", "each once"), (str(delay), "-1e-6", "adc_start is .*0 or more"),
        ("use_receivers", "use_receiver", "Did you mean 'use_receivers'"),
    ):  # fmt: skip
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(written(tmp_path, text.replace(old, new) + PLANE_TEXT))


def test_transmitters_that_take_turns_many_times_a_frame(tmp_path):
    """Three transmitters, five chirps each, as mmWave Studio records them: `shape` tells the two apart."""
    tx, _ = save_plane(tmp_path, count=5, step=0.03)
    places = np.array([[0, 0, 0], [0.015, 0, 0], [0, 0.015, 0]])
    frames = frames_at(tx + places, np.repeat(tx, 2, axis=1), frequencies=FREQUENCIES[:32])
    counts = np.round(2000 * np.repeat(frames[:, None], 5, axis=1) * np.arange(1, 6)[:, None, None, None])
    write_dca1000(tmp_path / "f.bin", counts.reshape(25, 15, 2, 32), order="two-lane")
    text = RADAR + f"tx_positions = {places.tolist()}\nrx_positions = {[[0, 0, 0]] * 2}\n[frames]\nfile = 'f.bin'\n"
    text += 'samples = 32\nreceivers = 2\nchirps = 15\norder = "two-lane"\nphase_sign = -1\nchirp = "mean"\n'
    text += 'shape = [-1, 5, 3, 2, 32]\naxes = ["pose", "chirp", "tx", "rx", "sample"]\n' + PLANE_TEXT
    capture = read_capture(written(tmp_path, text))
    same_image(capture, image_of(3 * frames * 2000, tx + places, np.repeat(tx, 2, 1), 0, FREQUENCIES[:32]), 1e-3)
    for old, new, message in (
        (
            "[-1, 5, 3, 2, 32]",
            "[25, 5, 4, 2, 32]",
            r"one for the 24000 numbers in .*f.bin, \(25, 15, 2, 32\)",
        ),
        ("[-1, 5, 3, 2, 32]", "[5, 25, 3, 2, 32]", r"shape is .*25 first, the frames .*f.bin"),
        ("shape = [-1, 5, 3, 2, 32]\n", "", "axes is .*or others where shape says them"),
    ):
        with pytest.raises(ms.errors.FormatError, match=message):
            read_capture(written(tmp_path, text.replace(old, new)))


@pytest.mark.slow
def test_packets_of_a_dca1000(tmp_path):
    tx, _ = save_plane(tmp_path, count=9, step=0.02)
    frames = point_frames(POINTS, AMPLITUDES, tx, tx, FREQUENCIES[:32])
    counts = np.round(2000 * np.repeat(frames, 4, axis=2))
    write_dca1000(tmp_path / "f.bin", counts)
    recording = (tmp_path / "f.bin").read_bytes()
    (tmp_path / "f.pcap").write_bytes(pcap_of(recording + b"\1" * 10))
    text = RADAR + f"rx_positions = {[[0, 0, 0]] * 4}\n"
    text += '[frames]\nfile = "f.pcap"\nsamples = 32\nphase_sign = -1\norder = "four-lane"\n' + PLANE_TEXT
    expected = image_of(counts, tx, np.repeat(tx, 4, axis=1), frequencies=FREQUENCIES[:32])
    same_image(read_capture(written(tmp_path, text)), expected)
    # What never came is left out, and counted.
    (tmp_path / "f.pcap").write_bytes(pcap_of(recording, lost=(5,)))
    capture = read_capture(written(tmp_path, text))
    lost = capture.metadata["history"][0]["lost"]
    assert 0 < lost < 10
    assert len(capture.trajectory) == 81 - lost


# Falling sweeps


@pytest.mark.parametrize(
    "radar",
    [
        f"start_frequency = {FREQUENCIES[-1]}\nstep = {-STEP}",
        f"start_frequency = {FREQUENCIES[-1]}\nslope = {-STEP * 1e6}\nsample_rate = 1e6",
        f"start_frequency = {FREQUENCIES[-1]}\nstop_frequency = {START}",
        f"frequencies = {FREQUENCIES[::-1].tolist()}",
    ],
)
def test_a_falling_sweep_is_described_as_it_was_sent(tmp_path, radar):
    tx, frames = save_plane(tmp_path, count=5, step=0.03)
    np.save(tmp_path / "f.npy", frames[:, 0, 0, ::-1])
    text = f'[radar]\n{radar}\n[frames]\nfile = "f.npy"\naxes = ["pose", "sample"]\nphase_sign = -1\n' + PLANE_TEXT
    capture = read_capture(written(tmp_path, text))
    assert np.allclose(capture.radar.waveform.frequencies, FREQUENCIES[::-1], rtol=1e-12)
    same_image(capture, image_of(frames, tx))


# Another radar's raw frames are one new file


def test_a_new_raw_format_is_one_function(tmp_path, monkeypatch):
    tx, frames = save_plane(tmp_path, count=5, step=0.03)
    (tmp_path / "f.xyz").write_bytes(b"XYZ1" + frames.astype("<c8").tobytes())

    def read(path, *, length):
        values = np.frombuffer(path.read_bytes()[4:], "<c8").reshape(-1, length)
        return RawArray(values=values, frequencies=FREQUENCIES)

    RAW_FORMATS.names()
    monkeypatch.setattr(RAW_FORMATS, "_entries", dict(RAW_FORMATS._entries))
    RAW_FORMATS.add("xyz", RawFormat(suffixes=(".xyz",), keys=("length",), read=read, axes=("pose", "sample")))
    assert "xyz: state length in a description" in run_here("info", tmp_path / "f.xyz")[1]
    whole = RawFormat(suffixes=(".all",), keys=(), read=lambda path: read(path, length=41), axes=("pose", "sample"))
    RAW_FORMATS.add("all", whole)
    (tmp_path / "f.xyz").with_suffix(".all").write_bytes((tmp_path / "f.xyz").read_bytes())
    assert "all: 25 x 41 complex64 (pose, sample)" in run_here("info", tmp_path / "f.all")[1]
    text = '[radar]\n[frames]\nfile = "f.xyz"\nlength = 41\nphase_sign = -1\n' + PLANE_TEXT
    same_image(read_capture(written(tmp_path, text)), image_of(frames, tx))
    same_image(read_capture(written(tmp_path, text.replace("length", 'format = "xyz"\nlength'))), image_of(frames, tx))
    with pytest.raises(ms.errors.UnknownNameError, match=r"format in .*'xzy'. Did you mean 'xyz'"):
        read_capture(written(tmp_path, text.replace("length", 'format = "xzy"\nlength')))
    with pytest.raises(ms.errors.FormatError, match="order is 'two-lane'; expected no such key with the format 'xyz'"):
        read_capture(written(tmp_path, text.replace("length", 'order = "two-lane"\nlength')))


# Other people's captures


@pytest.mark.slow
def test_the_aeroplane_has_fuselage_and_wings():
    data = shared("captures", "aeroplane_215_228ghz.mat").parent
    capture = read_capture(EXAMPLES / "aeroplane.toml", data=data)
    grid = ms.VoxelGrid.regular(**capture.metadata["image_grid"])
    image = ms.form_image(capture, grid, method="backprojection")
    assert image.magnitude.max() == pytest.approx(17.93, rel=0.01)
    assert np.allclose(image.peak, [-0.180, -0.072, 0], atol=0.0031)
    other = ms.Capture(radar=capture.radar, trajectory=capture.trajectory, frames=capture.frames.conj())
    turned = ms.form_image(other, grid, method="backprojection")
    assert turned.magnitude.max() == pytest.approx(17.69, rel=0.01)
    assert np.allclose(turned.peak, [0.177, 0.078, 0], atol=0.0031)


@pytest.mark.slow
def test_the_tumour_in_the_phantom_is_where_it_is_stated():
    data = shared("captures", "merit", "B0_P3_p000.csv").parent
    capture = read_capture(EXAMPLES / "phantom.toml", data=data)
    image = ms.form_image(capture, ms.VoxelGrid.regular(**capture.metadata["image_grid"]), method="exact")
    assert np.allclose(image.peak, [0.015, 0.0025, 0.0275], atol=1e-6)
    # The figure beside the data is the mean over all 24 x 24 pairs, 96 of which were measured.
    assert image.magnitude.max() * 96 / 24**2 == pytest.approx(4.00e-5, rel=0.005)
