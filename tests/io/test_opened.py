"""What HDF5 files may hold, sealed or not: one tree of numbers, whose bytes lie in the file."""

import os
import re
import resource
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

import millisight as ms
from helpers.forging import forge, patch
from helpers.processes import files_to_open
from helpers.small_records import same, small_capture
from millisight.core import limits_of
from millisight.core.errors import DamagedFileError, FileError, FormatError
from millisight.io import load_extras, open_image, provenance

SECRET = np.arange(3.0)


@pytest.fixture
def saved(tmp_path):
    """A trajectory, and beside it two files whose bytes it must not give away."""
    path = tmp_path / "t.h5"
    ms.save(path, small_capture().trajectory, extras={"more": SECRET})
    SECRET.tofile(tmp_path / "secret.bin")
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["times"] = SECRET
    return path


def as_schema_1(path):
    """The file as versions before the seal wrote it."""
    with h5py.File(path, "r+") as file:
        file.attrs["schema_version"] = 1


def external(file):
    count = len(file["times"])
    del file["times"]
    file.create_dataset("times", (count,), "f8", external=[("secret.bin", 0, 8 * count)])


def linked(file):
    del file["times"]
    file["times"] = h5py.ExternalLink("secret.h5", "times")


def soft(file):
    del file["times"]
    file["times"] = h5py.SoftLink("/positions")


def virtual(file):
    count = len(file["times"])
    layout = h5py.VirtualLayout((count,), "f8")
    layout[:] = h5py.VirtualSource("secret.h5", "times", (3,))[:count] if count <= 3 else np.nan
    del file["times"]
    file.create_virtual_dataset("times", layout)


def twice(file):
    file["again"] = file["times"]


def itself(file):
    file["loop"] = file["/"]


def around(file):
    file["a"] = h5py.SoftLink("/b")
    file["b"] = h5py.SoftLink("/a")


def reference(file):
    file.create_dataset("reference", data=file["times"].ref, dtype=h5py.ref_dtype)


def deep(file):
    file.create_group("/".join("x" * 200))


def many_texts(file):
    file.attrs.create("format", ["a", "b"], dtype=h5py.string_dtype())


def sequences(file):
    one = np.empty(1, dtype=object)
    one[0] = np.arange(3)
    file["times"].attrs.create("unit", one, dtype=h5py.vlen_dtype(np.int64))


def long_list(file):
    file["times"].attrs["unit"] = np.zeros(8000)


def packed(file):
    values = file["times"][...]
    del file["times"]
    file.create_dataset("times", data=values, chunks=values.shape, compression="gzip")


def words(file):
    file["words"] = ["a", "b"]


def named_type(file):
    file["kind"] = np.dtype("f8")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (external, "times: its bytes lie in another file"),
        (linked, "times: a link that may lead elsewhere"),
        (soft, "times: a link that may lead elsewhere"),
        (twice, "linked twice"),
        (itself, "loop: linked twice"),
        (packed, "times: compressed"),
        (around, "[ab]: a link that may lead elsewhere"),
        (reference, "reference: of the type object; expected numbers"),
        (deep, "linked twice, too deep, or one of too many"),
        (sequences, "times: unit is neither a number nor a text"),
        (long_list, "times: unit is neither a number nor a text"),
        (words, "words: of the type object; expected numbers"),
        (named_type, "kind: neither a group nor an array"),
    ],
)
@pytest.mark.parametrize("sealed", [True, False])
def test_no_file_leads_out_of_itself(saved, change, message, sealed, monkeypatch):
    monkeypatch.chdir(saved.parent)
    if sealed:
        forge(saved, change)
    else:
        with h5py.File(saved, "r+") as file:
            change(file)
        as_schema_1(saved)
    for read in (ms.load, load_extras, provenance) if sealed else (ms.load,):  # those start a process each
        with pytest.raises(DamagedFileError, match=rf"t\.h5 is damaged at .*{message}"):
            read(saved)


@pytest.mark.parametrize("read", [load_extras, provenance])
def test_no_reader_leads_out_of_a_file_without_a_seal(saved, read, monkeypatch):
    monkeypatch.chdir(saved.parent)
    with h5py.File(saved, "r+") as file:
        linked(file)
    as_schema_1(saved)
    with pytest.raises(DamagedFileError, match=r"t\.h5 is damaged at .*times: a link that may lead elsewhere"):
        read(saved)


def test_a_link_of_a_kind_that_nobody_knows_is_refused(saved):
    forge(saved, linked)

    def change(data):
        place = data.index(b"\x01\x08\x40\x05times")  # a link's message; its third byte is the kind, 64: external
        data[place + 2] = 77

    patch(saved, change)
    with pytest.raises(DamagedFileError, match=r"t\.h5 is damaged"):
        ms.load(saved)


def one_attribute(file):
    """Texts of one attribute, each of a length of its own."""
    del file.attrs["format"]
    file.attrs.create("format", ["x" * length for length in LENGTHS], dtype=h5py.string_dtype())


def many_attributes(file):
    for i, length in enumerate(LENGTHS):
        file.create_group(f"g{i}").attrs["record"] = "x" * length


LENGTHS = (500_000, *range(1000, 1300))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (one_attribute, FormatError, "not written by millisight"),
        (many_attributes, DamagedFileError, "texts that share their bytes"),
    ],
)
def test_texts_that_name_one_text_many_times_are_not_read(saved, change, error, message):
    """With 3 500 names a file of 1 MB took 6 GB and half a minute."""
    forge(saved, change)

    def reference(data, length):
        """Where the reference to a text lies: its length (4 bytes), its heap's place (8), its number there (4)."""
        for found in re.finditer(re.escape(length.to_bytes(4, "little")), data):
            heap = int.from_bytes(data[found.end() : found.end() + 8], "little")
            if data[heap : heap + 4] == b"GCOL":
                return found.start()
        raise LookupError(length)

    def share(data):
        one = reference(data, LENGTHS[0])
        for length in LENGTHS[1:]:
            place = reference(data, length)
            data[place : place + 16] = data[one : one + 16]

    patch(saved, share)
    with h5py.File(saved, "r") as file:
        held = file.attrs["format"][-1] if change is one_attribute else file["g300"].attrs["record"]
        assert len(held) == LENGTHS[0]
    assert saved.stat().st_size < 2_000_000
    with memory_below(100), pytest.raises(error, match=message):
        ms.load(saved)


def test_arrays_that_share_their_bytes_are_refused(saved):
    """Hundreds of arrays could be the same bytes of the file, and would be read hundreds of times."""

    def change(file):
        for i in range(300):
            file[f"extras/e{i}"] = np.arange(10_000.0) if not i else np.zeros(1)

    forge(saved, change)
    with h5py.File(saved, "r") as file:
        places = [file[f"extras/e{i}"].id.get_offset() for i in range(300)]

    def share(data):
        for place in places[1:]:
            # Place and size of the array's values; then how many there are, and how many there may be.
            at = data.index(place.to_bytes(8, "little") + (8).to_bytes(8, "little"))
            data[at : at + 16] = places[0].to_bytes(8, "little") + (80_000).to_bytes(8, "little")
            space = data.rindex(b"\x01\x01\x01\0" + bytes(4) + (1).to_bytes(8, "little") * 2, 0, at)
            data[space + 8 : space + 24] = (10_000).to_bytes(8, "little") * 2

    patch(saved, share)
    with h5py.File(saved, "r") as file:
        assert file["extras/e7"][-1] == 9999
    for read in (ms.load, load_extras, provenance):
        with pytest.raises(DamagedFileError, match="its bytes are another array's, too"):
            read(saved)


@contextmanager
def memory_below(megabytes):
    """Within the block this process may not grow by more."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + megabytes * 1_000_000, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def test_a_virtual_array_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.02, 0, 0), 0.01)
    assert grid.shape == (3, 1, 1)
    ms.save("i.h5", ms.SarImage(grid=grid, values=np.ones(grid.shape)))
    with h5py.File("secret.h5", "w") as file:
        file["values"] = np.full(grid.shape, 7, "c8")

    def change(file):
        layout = h5py.VirtualLayout(grid.shape, "c8")
        layout[:] = h5py.VirtualSource("secret.h5", "values", grid.shape)
        del file["values"]
        file.create_virtual_dataset("values", layout)

    forge("i.h5", change)
    with pytest.raises(DamagedFileError, match="values: its bytes lie in another file"):
        ms.load("i.h5")
    with pytest.raises(DamagedFileError, match="values: its bytes lie in another file"), open_image("i.h5"):
        pass


def test_a_chunk_larger_than_the_file_is_refused(saved):
    """HDF5 would ask for a whole chunk, whatever the array is in size."""

    def change(file):
        del file["times"]
        made = file.create_dataset("times", (5,), "f8", chunks=(1 << 28,), maxshape=(None,), fletcher32=True)
        made.id.write_direct_chunk((0,), bytes(44))

    forge(saved, change)
    with pytest.raises(DamagedFileError, match=f"44 bytes stored, {8 << 28} expected"):
        ms.load(saved)


@pytest.mark.slow
def test_files_without_a_seal_are_read_by_way_of_a_copy(tmp_path, monkeypatch):
    """All of them: record, extras, provenance, frames on disk; and nothing of the copy stays."""
    capture = small_capture()
    ms.save(tmp_path / "c.h5", capture, extras={"scalar": np.array(3.5), "text": {"a": [1]}})
    as_schema_1(tmp_path / "c.h5")
    told = provenance(tmp_path / "c.h5")
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setattr("tempfile.tempdir", None)
    (tmp_path / "temporary").mkdir()
    assert same(ms.load(tmp_path / "c.h5"), capture)
    assert load_extras(tmp_path / "c.h5") == {"scalar": 3.5, "text": {"a": [1]}}
    assert told["schema_version"] == 1
    assert told["record"] == "Capture"
    assert told["created"] != "unknown"
    with ms.open_capture(tmp_path / "c.h5") as lazy:
        assert np.array_equal(lazy.frames_of(slice(0, 2)), capture.frames[:2])
    assert not list((tmp_path / "temporary").iterdir())


def test_a_newer_file_without_its_seal_is_damaged(saved):
    with open(saved, "r+b") as raw:
        raw.seek(-1, os.SEEK_END)
        raw.write(b"?")
    with pytest.raises(DamagedFileError, match=r"t\.h5 has no checksum: it is damaged, or another program changed it"):
        ms.load(saved)


@pytest.mark.parametrize(
    ("script", "message"),
    [("kill -SEGV $$", "the library that reads it fails"), ("exec sleep 60", "the library that reads it fails")],
)
def test_a_crash_or_a_hang_of_the_library_is_an_error(saved, script, message, monkeypatch):
    import millisight.io._children as children

    as_schema_1(saved)
    crashing = saved.parent / "python"
    crashing.write_text(f"#!/bin/sh\n{script}\n")
    crashing.chmod(0o755)
    monkeypatch.setattr(children.sys, "executable", str(crashing))
    monkeypatch.setattr(children, "limits_of", lambda size: limits_of(size)._replace(seconds=0.5))
    began = time.monotonic()
    with pytest.raises(DamagedFileError, match=rf"t\.h5 cannot be opened as HDF5: {message}"):
        ms.load(saved)
    assert time.monotonic() - began < 10


SHORTER = """#!/bin/sh
exec "{python}" -P -c '
import runpy, sys
from millisight.io import _children
_children._PROCESSOR = 1.0, 5e7
sys.argv[:4] = sys.argv[3:4]
runpy.run_module(sys.argv[0], run_name="__main__")
' "$@"
"""
"""A Python whose processes that read are given a second of processor time, not five: `python -P -m module path ...`."""


@pytest.mark.slow
def test_a_file_that_the_library_walks_for_ever_ends_within_seconds_of_processor_time(saved, monkeypatch):
    """The heap that holds its texts ends with free space of no bytes: found by `tests/fuzz/parsers.py`."""
    import millisight.io._children as children

    assert children._PROCESSOR[0] == 5
    (saved.parent / "python").write_text(SHORTER.format(python=sys.executable))
    (saved.parent / "python").chmod(0o755)
    monkeypatch.setattr(children.sys, "executable", str(saved.parent / "python"))
    as_schema_1(saved)
    data = bytearray(saved.read_bytes())
    place = data.index(b"GCOL") + 16
    while data[place]:
        place += 16 + -(-int.from_bytes(data[place + 8 : place + 16], "little") // 8) * 8
    data[place + 8 : place + 16] = bytes(8)
    saved.write_bytes(data)
    began = sum(os.times()[:4])
    with pytest.raises(DamagedFileError, match=r"t\.h5 cannot be opened as HDF5: the library that reads it fails"):
        ms.load(saved)
    assert 1 < sum(os.times()[:4]) - began < 5


@pytest.mark.slow
def test_hdf5_never_opens_a_file_without_a_seal_here(saved, tmp_path, monkeypatch):
    """A damaged file of schema 1 is an error, or the record; this process opens sealed copies alone."""
    as_schema_1(saved)
    whole, record = saved.read_bytes(), ms.load(saved)
    opened, open_file = [], h5py.File
    monkeypatch.setattr(h5py, "File", lambda path, *mode: (opened.append(str(path)), open_file(path, *mode))[1])
    noticed = 0
    for place in (8, 24, 64, 72, 96, 136):  # superblock and the root's header
        damaged = bytearray(whole)
        damaged[place : place + 4] = b"\xff" * 4
        saved.write_bytes(damaged)
        try:
            found = ms.load(saved)
        except FileError:
            noticed += 1
        else:
            assert isinstance(found, type(record))
    assert noticed >= 3
    assert str(saved) not in opened


def test_other_peoples_files_and_truncated_ones_are_named(tmp_path, saved):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = h5py.ExternalLink("secret.h5", "times")
    with pytest.raises(FormatError, match=r"other\.h5 is HDF5, but not written by millisight"):
        ms.load(tmp_path / "other.h5")
    whole = saved.read_bytes()
    saved.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DamagedFileError, match=rf"t\.h5 is cut short: {len(whole) // 2} bytes are left of \d+"):
        ms.load(saved)


def test_a_limit_of_the_process_is_not_called_damage(saved):
    ms.load(saved)  # so that all is imported
    told = []
    for spare in range(4):
        with files_to_open(spare):
            try:
                ms.load(saved)
            except FileError as error:
                told.append(str(error))
    assert told
    assert all("Too many open files" in text and "damaged" not in text for text in told)
