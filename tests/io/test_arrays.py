"""Arrays come back from every format as they were saved; what is damaged, foreign or a bomb is an error with a name."""

import io
import json
import os
import re
import resource
import struct
import subprocess
import sys
import time
import zipfile
import zlib

import h5py
import numpy as np
import pytest

from millisight.core import limits_of
from millisight.core.errors import DamagedFileError, FileError, FormatError, UnknownNameError
from millisight.io.arrays import array_shapes, read_arrays, small_files_kept

MUTATIONS = 300


def some_arrays():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(3, 4, 5))
    return {
        "frames": (values + 1j * values[::-1]).astype(np.complex64), "double": values,
        "complex": values[0] - 2j * values[1], "bytes": np.arange(6, dtype=np.uint8).reshape(2, 3),
        "shorts": np.array([[-5, 300]], dtype=np.int16),
        "longs": np.array([[2**62]]), "single": values[:1, 0].astype(np.float32),
    }  # fmt: skip


def same(found, expected):
    """Whether the arrays are equal in names, types, shapes and values."""
    assert list(found) == list(expected)
    return all(
        found[name].dtype == expected[name].dtype
        and found[name].shape == expected[name].shape
        and np.array_equal(found[name], expected[name])
        for name in expected
    )


def save_in_a_row(path, arrays):
    with open(path, "wb") as file:
        for array in arrays:
            np.save(file, array)


def save_matlab73(path, arrays, **options):
    """A file as MATLAB 7.3 writes it: HDF5 behind a header, axes in reverse, complex numbers as {real, imag}."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            stored = array.T
            if array.dtype.kind == "c":
                part = array.real.dtype
                stored = np.zeros(array.T.shape, dtype=[("real", part), ("imag", part)])
                stored["real"], stored["imag"] = array.real.T, array.imag.T
            kind = {"f8": "double", "c16": "double", "f4": "single", "c8": "single"}.get(
                array.dtype.str[1:], array.dtype.name
            )
            file.create_dataset(name.replace(".", "/"), data=stored, **options).attrs["MATLAB_class"] = np.bytes_(kind)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + b"\0" * 8 + b"\0\2IM")


def test_npy_holds_one_array_or_several(tmp_path):
    arrays = [
        *some_arrays().values(),
        np.float64(2.5),
        np.int32(7),
        np.asfortranarray(np.eye(2, 3)),
        np.array(["ü", "ab"]),
    ]
    save_in_a_row(tmp_path / "a.npy", arrays)
    expected = {str(i): np.asarray(array) for i, array in enumerate(arrays)}
    found = read_arrays(tmp_path / "a.npy")
    assert same(found, expected)
    assert not any(array.flags.writeable for array in found.values())
    assert array_shapes(tmp_path / "a.npy") == {name: array.shape for name, array in expected.items()}
    assert list(read_arrays(tmp_path / "a.npy", names=["8", "1"])) == ["8", "1"]


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz(tmp_path, save):
    arrays = {**some_arrays(), "big-endian": np.arange(3, dtype=">i4"), "mask": np.array([True, False])}
    save(tmp_path / "a.npz", **arrays)
    assert same(read_arrays(tmp_path / "a.npz"), arrays)
    assert array_shapes(tmp_path / "a.npz")["frames"] == (3, 4, 5)


@pytest.mark.slow
@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_5(tmp_path, compressed):
    import scipy.io

    arrays = {**some_arrays(), "flags": np.array([[True, False]])}
    record = {"x": np.eye(2), "label": "text", "inner": {"y": np.arange(3.0).reshape(1, 3)}}
    others = {
        "cells": np.array([1, "a"], dtype=object),
        "words": "text",
        "record": record,
        "many": np.zeros(2, "f8,i4"),
    }
    scipy.io.savemat(tmp_path / "a.mat", {**arrays, **others}, do_compression=compressed)
    found = read_arrays(tmp_path / "a.mat")
    assert same(found, {**arrays, "record.x": record["x"], "record.inner.y": record["inner"]["y"]})
    theirs = scipy.io.loadmat(tmp_path / "a.mat")
    assert all(np.array_equal(found[name], theirs[name]) for name in arrays)
    for name, reason in {"cells": "a cell array", "words": "text", "many": "array of structures"}.items():
        with pytest.raises(FormatError, match=rf"a\.mat: array '{name}' is .*{reason}"):
            read_arrays(tmp_path / "a.mat", names=[name])


def test_matlab_5_of_a_big_endian_machine(tmp_path):
    def element(kind, data):
        return struct.pack(">2I", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    values = np.arange(6, dtype=">u2").reshape(2, 3)
    matrix = element(6, struct.pack(">2I", 6, 0)) + element(5, struct.pack(">2i", 2, 3)) + element(1, b"narrow")
    matrix += element(4, values.tobytes(order="F"))  # doubles, stored as what is enough for them
    header = b"MATLAB 5.0 MAT-file".ljust(116) + b"\0" * 8 + b"\1\0MI"
    (tmp_path / "a.mat").write_bytes(header + element(14, matrix))
    assert same(read_arrays(tmp_path / "a.mat"), {"narrow": values.astype(float)})


@pytest.mark.parametrize("options", [{}, {"compression": "gzip", "shuffle": True}])
def test_matlab_73(tmp_path, options):
    arrays = dict(sorted(some_arrays().items()))
    save_matlab73(tmp_path / "a.mat", {**arrays, "record.x": np.eye(2, 3)}, **options)
    found = read_arrays(tmp_path / "a.mat")
    assert same(found, {**arrays, "record.x": np.eye(2, 3)})
    assert array_shapes(tmp_path / "a.mat")["frames"] == (3, 4, 5)


@pytest.mark.slow
def test_hdf5_of_any_origin(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["scan/frames"] = np.arange(6).reshape(2, 3) * 1j
        file["scan/itself"] = file["scan"]
        file["text"] = "hello"
        file["elsewhere"] = h5py.ExternalLink("b.h5", "/x")
        file.create_dataset("outside", (4,), "f8", external=[("/etc/passwd", 0, 32)])
        file.create_dataset("odd", data=np.zeros(9), chunks=(3,), compression="lzf")
    assert same(read_arrays(tmp_path / "a.h5"), {"scan/frames": np.arange(6).reshape(2, 3) * 1j})
    for name, reason in {"text": "no array of numbers", "outside": "lie in another file", "odd": "packed by"}.items():
        with pytest.raises(FormatError, match=rf"a\.h5: array '{name}' is .*{reason}"):
            read_arrays(tmp_path / "a.h5", names=[name])
    with pytest.raises(UnknownNameError, match=r"a\.h5: 'scan/frame'. Did you mean 'scan/frames'"):
        read_arrays(tmp_path / "a.h5", names=["scan/frame"])


def test_pickled_objects_are_never_read(tmp_path):
    objects = np.array([None, {}], dtype=object)
    np.savez(tmp_path / "a.npz", good=np.ones(2), bad=objects)
    np.save(tmp_path / "a.npy", objects)
    np.savez(tmp_path / "only.npz", bad=objects)
    assert list(read_arrays(tmp_path / "a.npz")) == ["good"]
    for path, names in ((tmp_path / "a.npz", ["bad"]), (tmp_path / "a.npy", None), (tmp_path / "only.npz", None)):
        with pytest.raises(FormatError, match=rf"{path.name}: .*Python objects, which are never read"):
            read_arrays(path, names=names)


def test_damage_is_told_with_the_files_and_the_arrays_name(tmp_path):
    good, path = np.arange(600.0), tmp_path / "some.npy"
    save_in_a_row(path, [good, good])
    whole = path.read_bytes()
    name = r"some\.npy is damaged: array '1' from byte 4928 on: "
    for data, message in [
        (whole[:-1], name + r"its float64 \(600,\) take 4800 bytes, and 4799 are left: truncated"),
        (whole[:4940], name + "its header"), (whole + b"more", "array '2' from byte 9856 on: it starts with b'more'"),
        (whole[:4928] + whole[4928:].replace(b"'<f8'", b"'|O8'"), "never read"), (b"", r"some\.npy: the file is empty"),
        (whole.replace(b"(600,)", b"(-60,)"), "not negative"), (whole.replace(b"(600,)", b"(60.,)"), "whole numbers"),
        (whole.replace(b"'<f8'", b"'<x8'"), "expected numbers, booleans or text"),
        (whole.replace(b"False", b"exit("), "its header .* cannot be read"),
        (whole.replace(b"\1\0v", b"\1\0\xff"), "its header .* cannot be read"),
        (whole.replace(b"\1\0v\0", b"\2\0v\0"), "its header claims"), (b"\0" * 500, "expected a .npy, .npz"),
    ]:  # fmt: skip
        path.write_bytes(data)
        with pytest.raises(FileError, match=message):
            read_arrays(path, names=["0", "1"])
    for bad, message in [(np.nan, r"has 2 values that are NaN or infinite, the first at \(1, 0\)"), (None, "is empty")]:
        array = np.zeros((0, 3)) if bad is None else np.array([[1, 2], [np.inf, bad]])
        np.savez(tmp_path / "a.npz", fine=good, bad=array)
        with pytest.raises(DamagedFileError, match=rf"a\.npz: array 'bad' {message}"):
            read_arrays(tmp_path / "a.npz")
        assert same(read_arrays(tmp_path / "a.npz", names=["fine"]), {"fine": good})
        assert read_arrays(tmp_path / "a.npz", finite=False)["bad"].shape == array.shape
    with pytest.raises(UnknownNameError, match=r"a\.npz: 'fin'. Did you mean 'fine'"):
        read_arrays(tmp_path / "a.npz", names=["fin"])
    with pytest.raises(FileError, match="no such file"):
        read_arrays(tmp_path / "missing.npz")
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(FormatError, match="no arrays of numbers; 'readme.txt' is no array"):
        read_arrays(tmp_path / "a.npz")


def npy_header(shape):
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text


@pytest.mark.slow
def test_what_unpacks_to_too_much_is_refused(tmp_path):
    import scipy.io

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    zeros = np.zeros(1 << 20, dtype=np.uint8)
    with (
        zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("zeros.npy", "w") as file,
    ):
        file.write(npy_header((72 << 17,)))
        for _ in range(72):
            file.write(zeros.data)
    (tmp_path / "lies.npy").write_bytes(npy_header((1 << 60,)) + b"\0" * 800)
    scipy.io.savemat(tmp_path / "a.mat", {"zeros": np.zeros(72 << 20, dtype=np.uint8)}, do_compression=True)
    scipy.io.savemat(tmp_path / "inside.mat", {"s": {"zeros": np.zeros(72 << 20, dtype=np.uint8)}}, do_compression=True)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("zeros", (1 << 40,), "f8", chunks=(1 << 20,), compression="gzip")
        file.create_dataset("unwritten", (1 << 20,), "f8", chunks=(1 << 10,))
    for name, names, message in [
        ("a.npz", None, "would unpack to 754975.. bytes or more"),
        ("a.mat", None, "takes 75497472 bytes, over the limit"),
        ("inside.mat", ["s.zeros"], "takes 75497472 bytes, over the limit"),
        ("lies.npy", None, "take 9223372036854775808 bytes, and 800 are left"),
        ("a.h5", ["zeros"], "takes 8796093022208 bytes, over the limit"), ("a.h5", ["unwritten"], "0 bytes are stored"),
    ]:  # fmt: skip
        with pytest.raises(FileError, match=rf"{re.escape(name)}.*{message}"):
            read_arrays(tmp_path / name, names=names)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 250_000  # kB
    for name, array in (("a.npz", "zeros"), ("inside.mat", "s.zeros")):
        assert read_arrays(tmp_path / name, max_bytes=200 << 20)[array].nbytes == 72 << 20


def test_a_crash_of_the_hdf5_library_is_an_error(tmp_path, monkeypatch):
    """Damaged files make it fail in ways that no Python code can catch."""
    import millisight.io._children as children

    save_matlab73(tmp_path / "a.mat", {"x": np.eye(3)})
    crashing = tmp_path / "python"
    for script, message in [
        ("kill -SEGV $$", "the library that reads it fails"),
        ("exec sleep 60", "the library that reads it fails"),
        ("echo [", "JSON|Expecting"),
    ]:
        crashing.write_text(f"#!/bin/sh\n{script}\n")
        crashing.chmod(0o755)
        monkeypatch.setattr(children.sys, "executable", str(crashing))
        monkeypatch.setattr(children, "limits_of", lambda size: limits_of(size)._replace(seconds=0.5))
        with pytest.raises(DamagedFileError, match=rf"a\.mat is damaged: .*({message})"):
            read_arrays(tmp_path / "a.mat")


@pytest.mark.slow
def test_a_small_file_is_read_once_where_several_of_its_arrays_are_wanted(tmp_path, monkeypatch):
    """A process takes longer to start than to read it. What is damaged or too much beside them does not matter."""
    from scipy.io import savemat

    started, start = [], subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *words, **how: started.append(words) or start(*words, **how))
    path = tmp_path / "a.mat"
    savemat(path, {"x": np.arange(3.0), "y": np.ones(2), "bad": [np.nan]})
    with small_files_kept():
        for _ in range(2):
            assert np.array_equal(read_arrays(path, names=["x"])["x"].ravel(), [0, 1, 2])
            assert np.array_equal(read_arrays(path, names=["y"])["y"].ravel(), [1, 1])
        assert len(started) == 1
        savemat(path, {"x": np.arange(4.0)})
        assert read_arrays(path, names=["x"])["x"].size == 4
        assert len(started) == 2
    read_arrays(path, names=["x"])
    assert len(started) == 3
    savemat(path, {"x": np.arange(3.0), "y": np.ones(2)})
    with small_files_kept():
        assert read_arrays(path, names=["x"], max_bytes=30)["x"].size == 3
        with pytest.raises(FileError, match="unpack to more than 30 bytes"):
            read_arrays(path, max_bytes=30)


def test_no_file_of_the_present_folder_is_run(tmp_path, monkeypatch):
    """Python looks for modules where it is started, unless it is told not to."""
    monkeypatch.chdir(tmp_path)
    for name in ("numpy", "json", "h5py"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close()")
    save_matlab73(tmp_path / "a.mat", {"x": np.eye(3)})
    assert np.array_equal(read_arrays("a.mat")["x"], np.eye(3))
    assert not (tmp_path / "ran").exists()


def mutated(rng, whole):
    data = bytearray(whole)
    for _ in range(rng.integers(1, 4)):
        place = int(rng.integers(len(data)))
        match rng.integers(5):
            case 0:
                data[place] = rng.integers(256)
            case 1:
                data[place : place + 4] = [b"\xff" * 4, b"\0" * 4, b"\0\0\0\x40", b"\1\0\0\0"][rng.integers(4)]
            case 2:
                del data[place : place + rng.integers(1, 9)]
            case 3:
                other = int(rng.integers(len(data)))
                data[place:place] = data[other : other + rng.integers(1, 30)]
            case 4 if rng.random() < 0.2:
                del data[max(1, place) :]
    return bytes(data)


READ_ALL = """
import json, sys
from pathlib import Path
import h5py, scipy.io  # here once, and not in each process that is forked
from fuzz.forks import forked
from millisight.core.errors import FileError
from millisight.io.arrays import read_arrays

told = {}
with forked():
    for path in Path(sys.argv[1]).iterdir():
        try:
            read_arrays(path)
            told[path.name] = ""
        except FileError as error:
            told[path.name] = str(error)
print(json.dumps(told))
"""
"""What becomes of every file in a folder; whatever is no error of ours ends it."""


@pytest.mark.slow
def test_mutated_files_end_in_arrays_or_in_an_error_of_ours(tmp_path):
    import scipy.io

    rng = np.random.default_rng(0)
    arrays = some_arrays()
    save_in_a_row(tmp_path / "0", arrays.values())
    np.savez(tmp_path / "1.npz", **arrays)
    np.savez_compressed(tmp_path / "2.npz", **arrays)
    scipy.io.savemat(tmp_path / "3.mat", {**arrays, "record": {"x": np.eye(2)}})
    scipy.io.savemat(tmp_path / "4.mat", arrays, do_compression=True)
    save_matlab73(tmp_path / "5.mat", arrays, compression="gzip")
    wholes = [entry.read_bytes() for entry in sorted(tmp_path.iterdir())]
    assert len(wholes) == 6
    (tmp_path / "mutated").mkdir()
    for number in range(MUTATIONS):
        # Each file of the last three kinds starts a process, so there are few of them.
        data = mutated(rng, wholes[number % 3 if number % 10 else 3 + number // 10 % 3])
        (tmp_path / "mutated" / f"{number}.some.file").write_bytes(data)
    settings = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", READ_ALL, tmp_path / "mutated"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=settings)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert len(told) == MUTATIONS
    assert all(not refusal or name in refusal for name, refusal in told.items())
    assert sum(not refusal or "array '" in refusal for refusal in told.values()) > MUTATIONS / 2


def test_members_that_share_their_bytes_are_refused(tmp_path):
    """The extra field of each member's header reaches over the headers behind it: 1 000 arrays of the same megabyte."""
    stream = io.BytesIO()
    np.save(stream, np.zeros(1 << 20, np.uint8))
    data, count, head = stream.getvalue(), 1000, 38
    heads, directory = b"", b""
    for i in range(count):
        name, extra = f"{i:04}.npy".encode(), head * (count - 1 - i)
        fields = struct.pack("<HHHHHIIIH", 20, 0, 0, 0, 33, zlib.crc32(data), len(data), len(data), len(name))
        heads += b"PK\3\4" + fields + struct.pack("<H", extra) + name
        directory += b"PK\1\2" + struct.pack("<H", 20) + fields
        directory += struct.pack("<HHHHII", 0, 0, 0, 0, 0, head * i) + name
    end = struct.pack("<HHHHIIH", 0, 0, count, count, len(directory), len(heads) + len(data), 0)
    (tmp_path / "a.npz").write_bytes(heads + data + directory + b"PK\5\6" + end)
    began = time.process_time()
    with pytest.raises(DamagedFileError, match="its members overlap: it claims more than it holds"):
        read_arrays(tmp_path / "a.npz")
    assert time.process_time() - began < 2


def test_an_archive_is_opened_once_however_many_arrays_it_holds(tmp_path, monkeypatch):
    """Each opening reads the directory of all: a time that grows with their square."""
    np.savez(tmp_path / "many.npz", **{f"a{i}": np.float64(i) for i in range(50)})
    opened, whole = [], zipfile.ZipFile
    monkeypatch.setattr(zipfile, "ZipFile", lambda *args: opened.append(args) or whole(*args))
    assert read_arrays(tmp_path / "many.npz")["a49"] == 49
    assert len(opened) == 1
