"""Every record goes into a file and comes back; every damaged or foreign file is refused by name."""

import os
import resource
import shlex
import subprocess
import sys

import h5py
import numpy as np
import pytest

import millisight as ms
from helpers.forging import forge
from helpers.small_records import same, small_capture
from millisight.core.errors import DamagedFileError, FileError, FormatError, InputError
from millisight.data import CameraFrame, CameraMask, Intrinsics, Layers
from millisight.io import load_extras, open_image, provenance
from millisight.io._hdf5 import RECORDS
from millisight.io._seal import chunk_extents, write_seal


def one_of_each():
    capture = small_capture()
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.02, 0.01, 0), 0.01)
    scene = ms.Scene.from_mesh("cracker_box", vertices=None, material=ms.Material(name="odd", reflection=0.2 - 0.1j))
    layers = Layers(
        thicknesses=[0.1], indices=[1.5], normal=[0, 0, -1], moved=0.02, offset=0.1, error=1e-3
    )  # fmt: skip
    intrinsics = Intrinsics(fx=9.0, fy=9.0, cx=1.0, cy=0.5, width=3, height=2)
    depth, points = np.array([[1, 2, 3], [4, 5, np.nan]], np.float32), np.full((2, 3, 3), np.nan)
    return [
        capture.radar.waveform, capture.radar.array, capture.radar, capture.trajectory, capture, grid, grid.xy,
        ms.SarImage(grid=grid, values=np.arange(6).reshape(3, 2, 1) * (1 + 2j), metadata={"ö": "µ"}),
        ms.Mask(grid_xy=grid.xy, inside=[[True, False]] * 3),
        ms.VolumeMask(grid=grid, inside=[[[True], [False]]] * 3),
        ms.PointCloud(
            points=[[0, 0, 1]], normals=[[0, 0, 1]], place_sigma=[0.001], normal_sigma_deg=[2], metadata={"seen": True}
        ),
        ms.Surface(mesh=scene.mesh, sigma=np.full(len(scene.mesh.vertices), 1e-3), metadata={"patches": 1}),
        ms.Instances(grid_xy=grid.xy, labels=[[1, 2], [1, 0], [0, 0]], scores=[3.0, 2.0]),
        ms.Prediction(probabilities=[0.25, 0.75], class_names=("can", "box")),
        scene.mesh, scene.objects[0].material, scene.objects[0], scene + scene.moved((1, 0, 0)), intrinsics, layers,
        CameraFrame(rgb=np.ones((2, 3, 3), np.uint8), depth=depth, pose=np.eye(4), intrinsics=intrinsics),
        CameraMask(pixels=depth > 2, depth=depth, points=points, pose=np.eye(4), metadata={"a": 1}),
    ]  # fmt: skip


def test_there_is_one_of_each():
    assert {type(r).__name__ for r in one_of_each()} == set(RECORDS)


@pytest.mark.parametrize("record", one_of_each(), ids=lambda r: type(r).__name__)
def test_round_trip_is_bit_for_bit(record, tmp_path):
    ms.save(tmp_path / "r.h5", record)
    assert same(record, ms.load(tmp_path / "r.h5"))
    assert [p.name for p in tmp_path.iterdir()] == ["r.h5"]


def test_complex128_values_are_kept_to_the_last_bit(tmp_path):
    values = np.array([1 + 1e-12j, -0.0, np.pi]).reshape(3, 1, 1)
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.02, 0, 0), 0.01)
    ms.save(tmp_path / "i.h5", ms.SarImage(grid=grid, values=values))
    kept = ms.load(tmp_path / "i.h5").values
    assert kept.dtype == np.complex128
    assert kept.tobytes() == values.tobytes()


def test_axes_are_stated_as_the_record_has_them(tmp_path):
    for record in one_of_each():
        if isinstance(record, ms.Mask | ms.VolumeMask):
            ms.save(tmp_path / f"{type(record).__name__}.h5", record)
    for name, axes in (("Mask", "x, y"), ("VolumeMask", "x, y, z")):
        with h5py.File(tmp_path / f"{name}.h5", "r") as file:
            assert file["inside"].attrs["axes"] == axes


def test_extras_come_back_bit_for_bit_beside_the_record(tmp_path):
    extras = {
        "points": np.arange(6, dtype=">f4").reshape(2, 3), "none": np.zeros((0, 7)), "scalar": np.array(2.5, "f4"),
        "flags": np.array([True, False]), "phases": np.array([1j, np.nan]),
        "names": ["a", None, {"b": 1.5}], "µ": "text",
    }  # fmt: skip
    image = one_of_each()[7]
    ms.save(tmp_path / "i.h5", image, extras=extras)
    assert same(image, ms.load(tmp_path / "i.h5"))
    found = load_extras(tmp_path / "i.h5")
    assert set(found) == set(extras)
    for name, value in extras.items():
        assert (
            same(np.asarray(value), np.asarray(found[name])) if isinstance(value, np.ndarray) else found[name] == value
        )
    ms.save(tmp_path / "i.h5", image)
    assert load_extras(tmp_path / "i.h5") == {}


@pytest.mark.parametrize("extras", [{"a/b": 1}, {"": 1}, {"a": object()}, {"a": float("nan")}])
def test_extras_that_no_file_can_hold_are_refused(extras, tmp_path):
    with pytest.raises(InputError, match="extras"):
        ms.save(tmp_path / "i.h5", small_capture(), extras=extras)
    assert not list(tmp_path.iterdir())


def test_damaged_extras_are_refused(tmp_path):
    ms.save(tmp_path / "i.h5", small_capture(), extras={"words": ["a"]})
    content = (tmp_path / "i.h5").read_bytes()
    assert content.count(b'["a"]') == 1
    (tmp_path / "i.h5").write_bytes(content.replace(b'["a"]', b'["b"]'))
    with pytest.raises(DamagedFileError, match=r"i.h5 is damaged at extras"):
        load_extras(tmp_path / "i.h5")


def test_reproducible_files_are_equal_byte_for_byte(tmp_path):
    for name in "ab":
        ms.save(tmp_path / name, small_capture(), extras={"x": np.arange(3)}, reproducible=True)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    told = provenance(tmp_path / "a")
    assert (told["created"], told["command"], told["record"]) == ("unknown", "unknown", "Capture")
    ms.load(tmp_path / "a")


def test_bytes_do_not_depend_on_when_handles_close(tmp_path, monkeypatch):
    # A profiler that holds our frames, as Dask's does, keeps their handles open.
    ms.save(tmp_path / "a", small_capture(), reproducible=True)
    held, create = [], h5py.Group.create_dataset

    def create_and_hold(*arguments, **options):
        held.append(create(*arguments, **options))
        return held[-1]

    monkeypatch.setattr(h5py.Group, "create_dataset", create_and_hold)
    ms.save(tmp_path / "b", small_capture(), reproducible=True)
    assert len(held) > 4
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_file_explains_itself(tmp_path):
    ms.save(tmp_path / "c.h5", small_capture())
    with h5py.File(tmp_path / "c.h5") as file:
        assert file["frames"].attrs["phase_sign"] == -1
        assert file["frames"].attrs["axes"] == "pose, transmitter, receiver, sample"
        assert file["frames"].fletcher32
        assert file["trajectory/positions"].attrs["unit"] == "m"
        assert file["radar/waveform"].attrs["slope_unit"] == "Hz/s"
        assert set(file["frames"].dtype.fields or {"r", "i"}) == {"r", "i"}
    told = provenance(tmp_path / "c.h5")
    assert told["record"] == "Capture"
    assert told["code_version"] == ms.__version__
    assert told["schema_version"] == 2
    assert told["command"].endswith(shlex.join(sys.argv[1:]))


def test_frames_stay_on_disk_until_asked_for(tmp_path):
    capture = small_capture()
    ms.save(tmp_path / "c.h5", capture)
    with ms.open_capture(tmp_path / "c.h5") as on_disk:
        assert isinstance(on_disk.frames, h5py.Dataset)
        assert np.array_equal(on_disk.frames_of(slice(1, 2)), capture.frames[1:])
        ms.save(tmp_path / "copy.h5", on_disk)
    assert same(capture, ms.load(tmp_path / "copy.h5"))
    ms.save(tmp_path / "radar.h5", capture.radar)
    with pytest.raises(FormatError, match="holds a Radar; expected a Capture"), ms.open_capture(tmp_path / "radar.h5"):
        pass


def test_the_kind_of_record_can_be_asked_for(tmp_path):
    radar = ms.Radar.preset("iwr1443")
    ms.save(tmp_path / "radar.h5", radar)
    assert same(ms.load(tmp_path / "radar.h5", ms.Radar), radar)
    assert same(ms.load(tmp_path / "radar.h5", kind=ms.Radar), radar)
    with pytest.raises(FormatError, match=r"radar\.h5 holds a Radar; expected a SarImage"):
        ms.load(tmp_path / "radar.h5", ms.SarImage)
    for wrong in (int, "Radar", ms.Prompts):
        with pytest.raises(InputError, match="kind is .*; expected one of AntennaArray, CameraFrame"):
            ms.load(tmp_path / "radar.h5", wrong)


@pytest.mark.slow
def test_every_flipped_byte_is_noticed_or_harmless(tmp_path):
    capture = small_capture("mito-sim-24ghz")
    path = tmp_path / "c.h5"
    ms.save(path, capture)
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    noticed = 0
    for place in rng.integers(0, len(whole), 400):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            loaded = ms.load(path)
        except FileError:
            noticed += 1
        else:
            assert same(capture, loaded)
    assert noticed > 100


def test_hdf5_never_sees_a_damaged_structure(tmp_path, monkeypatch):
    """Some damaged bytes send it into an endless loop, others crash the process."""
    path = tmp_path / "c.h5"
    ms.save(path, small_capture(), extras={"scalar": np.array(3.5)})
    whole = path.read_bytes()
    with h5py.File(path) as file:
        extents = chunk_extents(file)
    assert len(extents) > 2
    chunks = np.zeros(len(whole), bool)
    for start, length in extents.tolist():
        chunks[start : start + length] = True
    monkeypatch.setattr(h5py, "File", lambda *_: pytest.fail("HDF5 was asked"))
    places = np.flatnonzero(~chunks)[:-8:37]  # the seal's own last bytes aside: without them there is none
    assert len(places) > 300
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        with pytest.raises((DamagedFileError, FormatError), match=r"c\.h5"):
            ms.load(path)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_truncated_files_are_refused(tmp_path, share):
    path = tmp_path / "c.h5"
    ms.save(path, small_capture())
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises((FormatError, DamagedFileError), match=r"c\.h5"):
        ms.load(path)


def test_foreign_files_are_named(tmp_path):
    (tmp_path / "text.h5").write_text("not HDF5")
    with pytest.raises(FormatError, match="is not an HDF5 file"):
        ms.load(tmp_path / "text.h5")
    (tmp_path / "empty.h5").touch()
    with pytest.raises(FormatError, match=r"empty\.h5 is empty; expected an HDF5 file"):
        ms.load(tmp_path / "empty.h5")
    for name in ("part.STL", "part.ply", "part.obj"):
        (tmp_path / name).write_text("solid part")
        with pytest.raises(FormatError, match=rf"{name} is a mesh; `millisight simulate` makes a capture of it"):
            ms.load(tmp_path / name)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["data"] = [1, 2, 3]
    with pytest.raises(FormatError, match="not written by millisight"):
        ms.load(tmp_path / "other.h5")
    with pytest.raises(FileError, match="no such file"):
        ms.load(tmp_path / "nowhere.h5")
    ms.save(tmp_path / "new.h5", small_capture())
    forge(tmp_path / "new.h5", lambda file: file.attrs.__setitem__("schema_version", 99))
    with pytest.raises(FormatError, match=r"schema version 99; .* upgrade it"):
        ms.load(tmp_path / "new.h5")


def test_an_array_that_claims_more_than_it_stores_is_refused(tmp_path):
    """A forged size must not exhaust the memory."""

    def claim(file):
        del file["positions"]
        file.create_dataset("positions", shape=(10**12, 3), dtype="f8", chunks=(1000, 3))

    ms.save(tmp_path / "t.h5", small_capture().trajectory)
    forge(tmp_path / "t.h5", claim)
    with pytest.raises(DamagedFileError, match="0 bytes stored"):
        ms.load(tmp_path / "t.h5")


def test_what_is_no_record_is_refused(tmp_path):
    with pytest.raises(InputError, match="save got ndarray; expected one of AntennaArray"):
        ms.save(tmp_path / "x.h5", np.zeros(3))
    assert not list(tmp_path.iterdir())


def test_a_failing_write_leaves_the_old_file_whole(tmp_path, monkeypatch):
    from millisight.io import _hdf5 as hdf5

    path = tmp_path / "c.h5"
    ms.save(path, small_capture())
    before = path.read_bytes()

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(hdf5, "_write_array", fail)
    with pytest.raises(FileError, match="No space left on device; nothing was changed"):
        ms.save(path, small_capture())
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["c.h5"]


def test_folders_that_cannot_be_written_to(tmp_path):
    with pytest.raises(FileError, match="cannot write"):
        ms.save(tmp_path / "missing" / "c.h5", small_capture())
    with pytest.raises(FileError, match="is a folder"):
        ms.save(tmp_path, small_capture())


FULL_DISK = """
import resource, signal, sys
import numpy as np
import millisight as ms
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
mesh = ms.TriangleMesh(vertices=np.random.default_rng(0).normal(size=(50_000, 3)), faces=[[0, 1, 2]])
try:
    ms.save(sys.argv[1], mesh)
except OSError as error:
    print("refused:", error)
"""


def test_a_disk_that_fills_up_leaves_no_half_file(tmp_path):
    """The largest size that a process may write is bounded, as on a full disk, without help from a mock."""
    path = tmp_path / "m.h5"
    done = subprocess.run([sys.executable, "-c", FULL_DISK, str(path)], capture_output=True, text=True, timeout=120)
    assert "refused: cannot write" in done.stdout, done.stderr
    assert done.returncode == 0
    assert not list(tmp_path.iterdir())
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != 200_000


@pytest.mark.skipif(os.name != "posix", reason="permissions are tested where they are POSIX's")
def test_a_read_only_folder_is_refused(tmp_path):
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o555)
    # The superuser may write anywhere: step down to another user for the attempt.
    superuser = os.geteuid() == 0
    if superuser:
        for parent in (tmp_path, *tmp_path.parents[:3]):
            parent.chmod(parent.stat().st_mode | 0o755)
        os.seteuid(65534)
    try:
        with pytest.raises(FileError, match=r"cannot write .*Permission denied; choose another folder"):
            ms.save(folder / "c.h5", small_capture())
    finally:
        if superuser:
            os.seteuid(0)
    assert not list(folder.iterdir())


def swap(file, name, source):
    del file[name]
    file.copy(file[source], name)


@pytest.mark.parametrize(
    "change",
    [
        lambda f: f.attrs.__setitem__("record", np.array([1, 2])),
        lambda f: f.attrs.__setitem__("record", h5py.Empty("f")),
        lambda f: f["radar"].attrs.__setitem__("record", np.zeros(3)),
        lambda f: swap(f, "radar", "trajectory"),
        lambda f: swap(f, "radar", "frames"),
        lambda f: swap(f, "frames", "radar"),
        lambda f: swap(f, "trajectory/times", "radar/array"),
        lambda f: f["radar/waveform"].attrs.__setitem__("samples_per_chirp", np.array([512, 512])),
        lambda f: f["radar/waveform"].attrs.__setitem__("slope", "steep"),
        lambda f: f["radar"].attrs.__delitem__("record"),
        lambda f: f.attrs.__setitem__("metadata", 'json:{"history": 3}'),
        lambda f: f.attrs.__setitem__("metadata", "json:[1, 2]"),
        lambda f: f.attrs.__setitem__("format", np.array([1, 2])),
        lambda f: f.attrs.__setitem__("schema_version", np.array([1, 2])),
    ],
)
def test_forged_files_are_refused(tmp_path, change):
    path = tmp_path / "c.h5"
    ms.save(path, small_capture())
    forge(path, change)
    with pytest.raises((DamagedFileError, FormatError), match=r"c\.h5"):
        ms.load(path)
    with pytest.raises((DamagedFileError, FormatError), match=r"c\.h5"), ms.open_capture(path):
        pass


def test_a_forged_provenance_is_told_as_text(tmp_path):
    path = tmp_path / "c.h5"
    ms.save(path, small_capture())
    forge(path, lambda f: (f.attrs.__setitem__("command", 1.5), f.attrs.__delitem__("created")))
    told = provenance(path)
    assert told["command"] == "1.5"
    assert told["created"] == "unknown"
    forge(path, lambda f: f.attrs.__setitem__("command", np.array([1, 2])))
    with pytest.raises(DamagedFileError, match="damaged at /: command is neither a number nor a text"):
        provenance(path)
    forge(path, lambda f: f.attrs.__setitem__("command", "json:["))
    with pytest.raises(DamagedFileError, match=r"c\.h5 is damaged: Expecting value"):
        provenance(path)


@pytest.mark.parametrize("path", [None, 3, b"c.h5", "", "c\0.h5", "c" * 300 + ".h5"])
def test_impossible_paths_are_refused(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for attempt in (lambda: ms.save(path, small_capture()), lambda: ms.load(path), lambda: provenance(path)):
        with pytest.raises(FileError, match=r"path is|File name too long"):
            attempt()
    assert not list(tmp_path.iterdir())


def test_a_folder_is_no_file(tmp_path):
    for attempt in (ms.load, provenance, lambda p: ms.save(p, small_capture())):
        with pytest.raises(FileError, match="is a folder"):
            attempt(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    for attempt in (ms.load, lambda p: ms.save(p, small_capture())):
        with pytest.raises(FileError, match="is a device or a pipe"):
            attempt(tmp_path / "pipe")


def test_long_names_in_any_script_are_written(tmp_path):
    for name in ("像" * 80 + ".h5", "ö.h5", os.fsdecode(b"\xff\xfe.h5")):
        ms.save(tmp_path / name, small_capture())
        assert same(small_capture(), ms.load(tmp_path / name))
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize("name", ["a\0b", "\udcff", "json:[1]", "", "µ"])
def test_any_text_comes_back(name, tmp_path):
    ms.save(tmp_path / "m.h5", ms.Material(name=name))
    assert ms.load(tmp_path / "m.h5").name == name


def test_a_link_is_followed(tmp_path):
    (tmp_path / "results").mkdir()
    target, link = tmp_path / "results" / "real.h5", tmp_path / "link.h5"
    for state in ("dangling", "there"):
        link.unlink(missing_ok=True)
        link.symlink_to(target)
        ms.save(link, small_capture())
        assert link.is_symlink(), state
        assert same(small_capture(), ms.load(target))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link.h5", "results"]


def test_permissions_are_kept_and_new_files_follow_the_umask(tmp_path):
    path = tmp_path / "c.h5"
    before = os.umask(0o027)
    try:
        ms.save(path, small_capture())
        assert path.stat().st_mode & 0o777 == 0o640
        path.chmod(0o600)
        ms.save(path, small_capture())
        assert path.stat().st_mode & 0o777 == 0o600
    finally:
        os.umask(before)


def test_a_capture_whose_file_is_closed_says_so(tmp_path):
    ms.save(tmp_path / "c.h5", small_capture())
    with ms.open_capture(tmp_path / "c.h5") as capture:
        assert repr(capture).endswith("on disk)")
    grid = ms.VoxelGrid.regular((0, 0, 0), (0, 0, 0), 0.01)
    for use in (
        lambda: capture.frames_of(slice(0, 1)),
        lambda: ms.form_image(capture, grid, method="exact"),
        lambda: ms.save(tmp_path / "d.h5", capture),
        lambda: ms.combine(capture, capture, alpha=(1, 1)),
    ):
        with pytest.raises(InputError, match=r"file was closed; use the capture inside the `with"):
            use()
    assert capture.channels == 8
    assert "on disk" in repr(capture)
    assert [p.name for p in tmp_path.iterdir()] == ["c.h5"]


def test_frames_damaged_on_disk_say_so(tmp_path):
    path = tmp_path / "c.h5"
    ms.save(path, small_capture())
    with h5py.File(path) as file:
        place = file["frames"].id.get_chunk_info(0).byte_offset
    data = bytearray(path.read_bytes())
    data[place] ^= 0xFF
    path.write_bytes(data)
    with ms.open_capture(path) as capture, pytest.raises(DamagedFileError, match="frames of poses 0 to 1 cannot be"):
        capture.frames_of(slice(0, 2))


@pytest.fixture
def chunked(tmp_path, monkeypatch):
    """A capture file of several chunks of frames, and where in the file each of them lies: first byte and length."""
    from millisight.io import _hdf5

    capture = small_capture()
    monkeypatch.setattr(_hdf5, "_CHUNK_BYTES", capture.frames[0].nbytes)
    ms.save(tmp_path / "a.h5", capture)
    places = []
    with h5py.File(tmp_path / "a.h5") as file:
        file["frames"].id.chunk_iter(lambda chunk: places.append((chunk.byte_offset, chunk.size)))
    assert len(places) == 2
    return tmp_path / "a.h5", places


def test_a_chunk_of_zeros_is_no_data(chunked):
    """Fletcher-32 of zeros is 0: only the seal tells them from what was written."""
    path, ((start, length), _) = chunked
    content = bytearray(path.read_bytes())
    content[start : start + length] = bytes(length)
    path.write_bytes(content)
    with pytest.raises(DamagedFileError, match="its checksum differs"):
        ms.load(path)
    with pytest.raises(DamagedFileError, match="its checksum differs"), ms.open_capture(path):
        pass


def test_exchanged_chunks_are_no_data(chunked):
    path, ((one, length), (other, _)) = chunked
    content = bytearray(path.read_bytes())
    both = content[one : one + length], content[other : other + length]
    content[one : one + length], content[other : other + length] = both[::-1]
    path.write_bytes(content)
    with pytest.raises(DamagedFileError, match="its checksum differs"):
        ms.load(path)


def test_zeros_that_were_written_are_data(tmp_path):
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.02, 0.01, 0), 0.01)
    ms.save(tmp_path / "zeros.h5", ms.SarImage(grid=grid, values=np.zeros(grid.shape)))
    assert not ms.load(tmp_path / "zeros.h5").values.any()


def _sealed_as_before(path):
    """The extents of such a seal are whole chunks, neighbours joined, the chunks' own checksums with them."""
    with h5py.File(path) as file:
        end = file.id.get_filesize()
        extents = chunk_extents(file)
    with open(path, "r+b") as raw:
        raw.seek(-48, os.SEEK_END)
        count = int.from_bytes(raw.read(8), "little")
        assert count == len(extents)
        raw.truncate(end - 48 - 16 * count)
        whole = extents + np.array([0, 4], "<u8")
        joined = []
        for start, length in whole.tolist():
            if joined and start == sum(joined[-1]):
                joined[-1][1] += length
            else:
                joined.append([start, length])
        assert len(joined) < count
        write_seal(raw, np.array(joined, "<u8"))


def _unsealed(path):
    """As version 1 wrote it."""
    with h5py.File(path, "r+") as file:
        file.attrs["schema_version"] = 1


@pytest.mark.parametrize("age", [_sealed_as_before, _unsealed])
def test_files_of_before_are_read(age, chunked, caplog):
    path, _ = chunked
    age(path)
    assert same(ms.load(path), small_capture())
    assert not [one for one in caplog.messages if "frames holds" in one]


@pytest.mark.parametrize("age", [_sealed_as_before, _unsealed])
def test_a_chunk_of_zeros_in_a_file_of_before_is_told(age, chunked, caplog):
    """Nothing but the seal of today tells whether it was lost."""
    path, (_, (start, length)) = chunked
    age(path)
    with open(path, "r+b") as file:
        file.seek(start)
        file.write(bytes(length))
    assert not ms.load(path).frames[1].any()
    (told,) = [one for one in caplog.messages if "frames holds" in one]
    assert "a.h5: frames holds 1 chunks of zeros alone, the first from index 1 on" in told
    assert "compare it with its source, then save it again" in told


def test_a_capture_cut_short_while_it_is_read_is_damaged(chunked):
    path, ((start, _), (other, _)) = chunked
    with ms.open_capture(path) as capture:
        os.truncate(path, max(start, other))
        with pytest.raises(DamagedFileError, match="frames of poses 0 to 1 cannot be trusted: the file was cut short"):
            capture.frames_of(slice(0, 2))


@pytest.fixture
def slabs(tmp_path, monkeypatch):
    """The file of an image of 16 chunks, and where the second half of them begins."""
    from millisight.io import _hdf5

    grid = ms.VoxelGrid.regular((0, 0, 0), (0.15, 0.07, 0.07), 0.01)
    image = ms.SarImage(grid=grid, values=np.ones(grid.shape, np.complex64))
    monkeypatch.setattr(_hdf5, "_CHUNK_BYTES", image.values[0].nbytes)
    ms.save(tmp_path / "i.h5", image, extras={"mask": np.ones(grid.shape)})
    places = []
    with h5py.File(tmp_path / "i.h5") as file:
        file["values"].id.chunk_iter(lambda chunk: places.append(chunk.byte_offset))
    assert len(places) == 16
    return tmp_path / "i.h5", sorted(places)[8]


def test_an_image_cut_short_while_it_is_read_is_damaged(slabs):
    path, half = slabs
    with open_image(path) as (grid, values):
        assert values[:].all()
        os.truncate(path, half)
        for i in range(grid.shape[0]):
            with pytest.raises(DamagedFileError, match=r"i\.h5 cannot be trusted: the file was cut short while it was"):
                values[i]


@pytest.mark.parametrize("read", [ms.load, load_extras])
def test_a_file_cut_short_while_it_is_loaded_is_damaged(slabs, monkeypatch, read):
    from millisight.io import _hdf5

    path, half = slabs
    read_item = _hdf5._read_item

    def cut_and_read(*arguments, **settings):
        os.truncate(path, half)
        return read_item(*arguments, **settings)

    monkeypatch.setattr(_hdf5, "_read_item", cut_and_read)
    with pytest.raises(DamagedFileError, match=r"i\.h5 (cannot be trusted: the file was cut short|is damaged)"):
        read(path)
