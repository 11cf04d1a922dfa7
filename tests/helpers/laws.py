"""Batteries of laws. A test class inherits one, names what it tests, and gets every law of its kind.

class TestFast(ImagerLaws):
    method = "fast"
"""

from functools import cache

import numpy as np
import pytest

import millisight as ms
from helpers.oracles import point_frames, relative
from millisight.io.description import read_frames
from millisight.io.raw import RAW_FORMATS

_RADAR = ms.Radar(
    name="laws",
    waveform=ms.Waveform(start_frequency=77e9, slope=3e9 / 48e-6, sample_rate=1e6, samples_per_chirp=48),
    array=ms.AntennaArray(
        tx_positions=np.array([[0.0, 0.0, 0.0], [0.004, 0.0, 0.0]]),
        rx_positions=np.array([[-0.006, 0.0, 0.0], [-0.006, 0.002, 0.0]]),
    ),
    path_offset=0.15,
)
_GRID = ms.VoxelGrid.regular((-0.03, -0.03, -0.02), (0.03, 0.03, 0.02), (0.003, 0.003, 0.005))


def _trajectory(poses=14, seed=0):
    """A jittered raster 0.25 m above the grid."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-0.05, 0.05, poses), np.linspace(-0.05, 0.05, poses), indexing="ij")
    positions = np.stack([x, y, np.full_like(x, 0.25)], axis=-1).reshape(-1, 3)
    positions = positions + rng.normal(0, 2e-4, positions.shape)
    return ms.Trajectory(times=np.arange(len(positions)) * 1e-3, positions=positions)


def _capture(points, amplitudes, *, radar=_RADAR, trajectory=None, shift=(0.0, 0.0, 0.0)):
    """The capture of point reflectors, the whole set-up shifted [m]."""
    trajectory = trajectory or _trajectory()
    moved = ms.Trajectory(times=trajectory.times, positions=trajectory.positions + np.array(shift))
    tx, rx = moved.placed(radar.array.tx_positions), moved.placed(radar.array.rx_positions)
    frequencies = radar.waveform.frequencies
    frames = point_frames(np.asarray(points) + np.array(shift), amplitudes, tx, rx, frequencies, radar.path_offset)
    return ms.Capture(radar=radar, trajectory=moved, frames=frames.astype(np.complex64))


def _reflectors(count=5, seed=3):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-0.025, -0.025, -0.015], [0.025, 0.025, 0.015], (count, 3))
    return points, rng.normal(size=count) + 1j * rng.normal(size=count)


class ImagerLaws:
    """What every linear imager obeys (paper Eq. 1), to its `tolerance`, a relative L2 error.

    `imager(capture, grid)` may be overridden; by default it is `ms.form_image` by `method`.
    """

    method = ""
    tolerance = 0.01

    def imager(self, capture, grid):
        return ms.form_image(capture, grid, method=self.method).values

    def test_a_unit_reflector_images_to_one_at_its_place(self):
        grid = ms.VoxelGrid.regular((-0.006, -0.006, -0.006), (0.006, 0.006, 0.006), 0.002)
        image = self.imager(_capture(np.zeros((1, 3)), np.ones(1)), grid)
        assert abs(image[3, 3, 3] - 1) < self.tolerance
        assert np.abs(image).argmax() == np.ravel_multi_index((3, 3, 3), image.shape)

    def test_it_agrees_with_the_exact_sum(self):
        points, amplitudes = _reflectors()
        capture = _capture(points, amplitudes)
        exact = ms.image_at(
            capture.frames, capture.tx_positions, capture.rx_positions, _RADAR.waveform.frequencies, _GRID.points, 0.15
        )
        assert relative(self.imager(capture, _GRID), exact) < self.tolerance

    def test_superposition(self):
        points, amplitudes = _reflectors()
        parts = sum(self.imager(_capture(p[None], a[None]), _GRID) for p, a in zip(points, amplitudes, strict=True))
        assert relative(self.imager(_capture(points, amplitudes), _GRID), parts) < self.tolerance

    def test_a_shift_of_the_whole_set_up_changes_nothing(self):
        points, amplitudes = _reflectors()
        shift = np.array([1.5, -2.25, 0.75])
        grid = ms.VoxelGrid(x=_GRID.x + shift[0], y=_GRID.y + shift[1], z=_GRID.z + shift[2])
        before = self.imager(_capture(points, amplitudes), _GRID)
        after = self.imager(_capture(points, amplitudes, shift=shift), grid)
        assert relative(after, before) < self.tolerance

    def test_swapping_transmitters_and_receivers_changes_nothing(self):
        points, amplitudes = _reflectors()
        array = ms.AntennaArray(tx_positions=_RADAR.array.rx_positions, rx_positions=_RADAR.array.tx_positions)
        swapped = ms.Radar(name="swapped", waveform=_RADAR.waveform, array=array, path_offset=_RADAR.path_offset)
        before = self.imager(_capture(points, amplitudes), _GRID)
        after = self.imager(_capture(points, amplitudes, radar=swapped), _GRID)
        assert relative(after, before) < self.tolerance

    def test_the_order_of_poses_does_not_matter(self):
        points, amplitudes = _reflectors()
        capture = _capture(points, amplitudes)
        order = np.random.default_rng(5).permutation(len(capture.trajectory))
        shuffled = ms.Capture(
            radar=_RADAR,
            trajectory=ms.Trajectory(times=capture.trajectory.times, positions=capture.trajectory.positions[order]),
            frames=capture.frames[order],
        )
        assert relative(self.imager(shuffled, _GRID), self.imager(capture, _GRID)) < self.tolerance

    def test_the_other_phase_sign_does_not_focus(self):
        capture = _capture(np.zeros((1, 3)), np.ones(1))
        wrong = ms.Capture(radar=_RADAR, trajectory=capture.trajectory, frames=np.conj(capture.frames))
        grid = ms.VoxelGrid.regular((-0.006, -0.006, -0.006), (0.006, 0.006, 0.006), 0.002)
        assert np.abs(self.imager(capture, grid)).max() > 0.98
        assert np.abs(self.imager(wrong, grid)).max() < 0.2

    def test_imaging_is_the_adjoint_of_scattering(self):
        """<A s, y> = <s, A* y>, with A* the imager times the number of samples."""
        grid = ms.VoxelGrid.regular((-0.02, -0.02, -0.01), (0.02, 0.02, 0.01), (0.01, 0.01, 0.01))
        rng = np.random.default_rng(6)
        amplitudes = rng.normal(size=grid.size) + 1j * rng.normal(size=grid.size)
        forward = _capture(grid.points, amplitudes)
        # Frames that the scene can make, and some that it cannot: of noise alone the product would be near zero.
        other = _capture(grid.points, amplitudes + 0.5 * rng.normal(size=grid.size)).frames
        noise = rng.normal(size=other.shape) + 1j * rng.normal(size=other.shape)
        frames = (other + 0.1 * np.abs(other).mean() * noise).astype(np.complex64)
        image = self.imager(ms.Capture(radar=_RADAR, trajectory=forward.trajectory, frames=frames), grid)
        left = np.vdot(forward.frames.astype(complex), frames)
        right = np.vdot(amplitudes, np.ravel(image).astype(complex) * frames.size)
        assert abs(left - right) < self.tolerance * abs(left)


@cache
def _box():
    return ms.Scene.from_mesh("cracker_box", vertices=3000)


class ScatteringLaws:
    """What every scattering model obeys: `model`, a name or an instance that `ms.simulate` takes."""

    model = ""

    def frames(self, scene, tx=(0.0, 0.0, 0.25), rx=(0.02, 0.0, 0.25), **settings):
        """(N,) of one pair of antennas."""
        array = ms.AntennaArray(tx_positions=np.zeros((1, 3)), rx_positions=np.array([np.subtract(rx, tx)]))
        radar = ms.Radar(name="laws", waveform=_RADAR.waveform, array=array, path_offset=0.0)
        trajectory = ms.Trajectory(times=np.zeros(1), positions=np.array([tx]))
        return ms.simulate(scene, radar, trajectory, model=self.model, **settings).frames[0, 0, 0]

    @pytest.fixture
    def box(self):
        return _box()

    def test_it_answers(self, box):
        assert np.abs(self.frames(box)).max() > 0

    def test_swapping_transmitter_and_receiver_changes_nothing(self, box):
        one, other = (0.01, 0.02, 0.25), (-0.03, 0.0, 0.27)
        assert relative(self.frames(box, other, one), self.frames(box, one, other)) < 1e-5

    def test_a_turn_of_the_whole_set_up_changes_nothing(self, box):
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        mesh = box.mesh.moved(rotation=turn)
        turned = ms.Scene(objects=(ms.SceneObject(name="turned", mesh=mesh, material=box.objects[0].material),))
        one, other = np.array([0.01, 0.02, 0.25]), np.array([-0.03, 0.0, 0.27])
        # Vertices at the limit of an angle may fall on either side of it.
        assert relative(self.frames(turned, turn @ one, turn @ other), self.frames(box, one, other)) < 0.02

    def test_what_is_hidden_does_not_answer(self, box):
        """A wall between the box and the antennas leaves the frames of the wall alone."""
        wall = ms.Scene.from_mesh("cracker_box", vertices=3000).moved((0.0, 0.0, 0.12))
        alone, both = (
            self.frames(wall, tx=(0, 0, 0.5), rx=(0, 0, 0.5)),
            self.frames(wall + box, (0, 0, 0.5), (0, 0, 0.5)),
        )
        assert np.abs(alone).max() > 0
        assert relative(both, alone) < 0.02

    def test_amplitudes_scale_with_the_reflection(self, box):
        metal = ms.Scene.from_mesh("cracker_box", vertices=3000, material="metal")
        half = ms.Material(name="half", reflection=0.5 * metal.objects[0].material.reflection, alpha=(1.0, 1.0))
        dim = ms.Scene.from_mesh("cracker_box", vertices=3000, material=half)
        assert relative(self.frames(dim), 0.5 * self.frames(metal)) < 1e-5

    def test_the_range_is_right(self, box):
        """The delay of the strongest echo lies between those of the nearest and the farthest corner."""
        frames = self.frames(box, (0, 0, 0.3), (0, 0, 0.3))
        step = _RADAR.waveform.frequency_step
        ranges = np.arange(4096) * 299_792_458.0 / step / 4096 / 2
        peak = ranges[np.abs(np.fft.fft(frames[::-1], 4096)).argmax()]
        corners = np.linalg.norm(box.mesh.vertices - np.array([0, 0, 0.3]), axis=1)
        assert corners.min() - 0.03 < peak < corners.max() + 0.03


class ReaderLaws:
    """What every reader of raw files obeys: `format`, a name in RAW_FORMATS.

    A subclass also has `write(path, values)`, which writes complex values as the format has them, and what it says of
    them here.
    """

    format = ""
    suffix = ""
    settings = ()  # (key, value) of [frames]
    axes = ("pose", "chirp", "rx", "sample")
    shape = (3, 2, 4, 16)
    tolerance = 1e-6  # relative
    cut = 3  # bytes that a truncated file lacks

    def write(self, path, values):
        raise NotImplementedError

    @property
    def values(self):
        rng = np.random.default_rng(7)
        return np.round(rng.uniform(-1000, 1000, (*self.shape, 2))).view(complex)[..., 0]

    @pytest.fixture
    def path(self, tmp_path):
        path = tmp_path / f"frames{self.suffix}"
        self.write(path, self.values)
        return path

    def raw(self, path):
        return RAW_FORMATS[self.format].read(path, **dict(self.settings))

    def described(self, path, more=""):
        """The description of a file with its radar's numbers made up, not even naming the format."""
        entry, sizes = RAW_FORMATS[self.format], dict(zip(self.axes, self.shape, strict=True))
        text = ["[radar]"]
        if self.raw(path).frequencies is None:
            text += ["start_frequency = 1e9", "step = 1e6"]
        text += [f"{kind}_positions = {[[0, 0, 0]] * sizes.get(kind, 1)}" for kind in ("tx", "rx")]
        text += ["[frames]", f'file = "{path.name}"', *(f"{key} = {value!r}" for key, value in self.settings)]
        if entry.phase_sign is None:
            text.append("phase_sign = -1")
        if entry.axes is None:
            text.append(f"axes = {list(self.axes)}")
        (path.parent / "scan.toml").write_text("\n".join([*text, more]).replace("'", '"'))
        return path.parent / "scan.toml"

    def test_it_reads_what_was_written(self, path):
        raw = self.raw(path)
        assert raw.values.shape == self.shape
        assert raw.values.dtype.kind == "c"
        assert np.abs(raw.values - self.values).max() <= self.tolerance * np.abs(self.values).max()
        assert raw.lost is None or (raw.lost.shape == self.shape[:1] and not raw.lost.any())

    def test_a_second_read_is_the_same_and_the_file_is_left_alone(self, path):
        before = path.read_bytes()
        first = self.raw(path)
        kept = first.values.copy()
        if first.values.flags.writeable:
            first.values[...] = 0
        assert np.array_equal(self.raw(path).values, kept)
        assert path.read_bytes() == before

    def test_a_truncated_file_is_refused_by_name(self, path):
        path.write_bytes(path.read_bytes()[: -self.cut])
        with pytest.raises(ms.errors.FileError, match=path.name):
            self.raw(path)

    @pytest.mark.parametrize("content", [b"", b"\x00" * 7, b"no frames at all\n"])
    def test_what_is_no_such_file_is_refused_by_name(self, path, content):
        path.write_bytes(content)
        with pytest.raises(ms.errors.FileError, match=path.name):
            self.raw(path)

    def test_a_missing_file_is_refused_by_name(self, path):
        path.unlink()
        with pytest.raises(ms.errors.FileError, match=path.name):
            self.raw(path)

    def test_its_keys_and_axes_are_those_of_the_protocol(self, path):
        entry = RAW_FORMATS[self.format]
        assert {key for key, _ in self.settings} <= set(entry.keys)
        assert entry.axes is None or tuple(entry.axes) == self.axes
        assert all(suffix.startswith(".") and suffix == suffix.lower() for suffix in entry.suffixes)

    def test_a_description_reads_the_same_by_suffix_alone(self, path):
        radar, frames = read_frames(self.described(path))
        expected = self.values
        if "chirp" in self.axes:
            expected = expected.take(0, self.axes.index("chirp"))
        rest = [axis for axis in self.axes if axis != "chirp"]
        expected = np.moveaxis(expected, rest.index("pose"), 0) if rest[0] != "pose" else expected
        sizes = dict(zip(self.axes, self.shape, strict=True))
        assert frames.shape == (sizes["pose"], sizes.get("tx", 1), sizes.get("rx", 1), sizes["sample"])
        assert np.abs(frames.reshape(expected.shape) - expected).max() <= max(self.tolerance, 1e-6) * 1500
        assert radar.waveform.samples_per_chirp == sizes["sample"]

    def test_fewer_receivers_than_recorded_are_said(self, path):
        places = "[positions]\npoints = " + str([[0, 0, 0]] * self.shape[self.axes.index("pose")])
        if "rx" not in self.axes:
            # One receiver: none can be left out, and nothing is said.
            assert not ms.read_capture(self.described(path, places)).metadata.get("notes")
            return
        count = self.shape[self.axes.index("rx")]
        radar, frames = read_frames(self.described(path, f"use_receivers = [{count - 1}]"))
        assert frames.shape[2] == len(radar.array.rx_positions) == 1
        assert np.array_equal(frames[:, :, 0], read_frames(self.described(path))[1][:, :, count - 1])
        capture = ms.read_capture(self.described(path, f"use_receivers = [0]\n{places}"))
        (note,) = capture.metadata["notes"][-1:]
        assert note == f"1 of {count} recorded receivers are read: 0"
