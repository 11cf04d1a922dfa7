"""Pickles give back arrays and plain values, and nothing else: what asks for more is refused by name, and not run."""

import copyreg
import functools
import os
import pickle
import pickletools
import re
import resource
import struct
import subprocess
import time

import numpy as np
import pytest

from millisight.core import limits_of
from millisight.core.errors import DamagedFileError, FileError, FormatError
from millisight.io.arrays import read_pickle

MUTATIONS = 300


def read(tmp_path, data):
    (tmp_path / "some.pkl").write_bytes(data)
    return read_pickle(tmp_path / "some.pkl")


def plain_values():
    grid = np.arange(24).reshape(2, 3, 4)
    return {
        "image": grid * (1 + 0.5j), "fortran": np.asfortranarray(grid), "turned": grid.transpose(1, 2, 0),
        "strided": np.arange(10)[::2], "big-endian": np.arange(3, dtype=">i4"), "mask": np.array([True, False]),
        "text": np.array(["ab", "ü"]), "bytes": np.array([b"ab", b"c"]), "0-d": np.array(3.5), "none": np.zeros((0, 3)),
        "nothing": np.array(None), "mapping": np.array({"x": 1}), "objects": np.array([1, "a", None, [2]], object),
        "scalar": np.float32(0.1), "complex": 1 + 2j, "type": np.dtype("f4"), "huge": 10**100, "negative": -5,
        "set": {1, "b"}, "frozen": frozenset([1, 2]), "tuple": (1, (2, (3, 4, 5, 6))), "empty": [(), [], {}, set()],
        "no bytes": b"",
        "raw": b"\x00\xff", "array of bytes": bytearray(b"x"), "ends": [True, False, None, float("inf")], 1: 2,
    }  # fmt: skip


def same(a, b):
    if isinstance(a, np.ndarray):
        shape = a.dtype == b.dtype and a.shape == b.shape
        return shape and all(map(same, a.ravel(), b.ravel())) if a.dtype.hasobject else shape and np.array_equal(a, b)
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    return type(a) is type(b) and a == b


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_plain_values_and_arrays_come_back(tmp_path, protocol):
    values = plain_values()
    values["again"] = values["image"]
    found = read(tmp_path, pickle.dumps(values, protocol=protocol))
    assert len(found) == len(values) > 25
    for key, value in values.items():
        assert same(value, found[key]), key
    assert found["again"] is found["image"]
    assert not found["image"].flags.writeable


def test_tuples_with_a_text_may_be_keys(tmp_path):
    values = {("004", "sugar_box"): "box", ("a", 1, True): [("b", 2)]}
    for protocol in (0, 2, 4, 5):
        assert read(tmp_path, pickle.dumps(values, protocol=protocol)) == values


def test_arrays_of_other_numpys_and_pythons(tmp_path):
    values = {"a": np.arange(6.0).reshape(2, 3), "s": np.float64(0.5)}
    for protocol in (2, 4, 5):
        data = pickle.dumps(values, protocol=protocol)
        assert b"numpy._core" in data
        if protocol == 2:  # its names end at a line's end, so any length will do
            assert same(values, read(tmp_path, data.replace(b"numpy._core", b"numpy.core")))
        else:
            older = data.replace(b"\x16numpy._core.multiarray", b"\x15numpy.core.multiarray")
            older = older.replace(b"\x13numpy._core.numeric", b"\x12numpy.core.numeric")
            assert b"_core" not in older
            assert same(values, read(tmp_path, re.sub(rb"\x95.{8}", b"", older, count=1, flags=re.DOTALL)))
    # Python 2 wrote an array's bytes as its text, which arrives as latin-1.
    python2 = (
        b"\x80\x02cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R(K\x01K\x02\x85cnumpy\ndtype\n"
        b"U\x02f8K\x00K\x01\x87R(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89U\x10"
        + struct.pack("<2d", 1.5, -2.0)
        + b"tb."
    )
    assert same(np.array([1.5, -2.0]), read(tmp_path, python2))


class Calls:
    """Pickles as a call of `function` with `arguments`, and a state to set afterwards."""

    def __init__(self, function, *arguments, state=None):
        self.call = (function, arguments) if state is None else (function, arguments, state)

    def __reduce__(self):
        return self.call


def attacks(mark):
    """Values whose pickles would make the file `mark`, or reach for more than values, and what must be refused."""
    touch = Calls(os.system, f"touch {mark}")
    in_objects = np.empty(1, dtype=object)
    in_objects[0] = touch
    command = f"open({str(mark)!r}, 'w')"
    return [
        ("system", touch), ("system", in_objects), ("system", np.array({"x": touch})),
        ("system", {"image": np.zeros(3), "more": [(1, {"deep": touch})]}),
        ("eval", Calls(eval, command)), ("exec", Calls(exec, command)), ("open", Calls(open, str(mark), "w")),
        ("getattr", Calls(getattr, {}, "get")), ("__import__", Calls(__import__, "os")),
        ("Popen", Calls(subprocess.Popen, ["touch", str(mark)])), ("partial", functools.partial(os.system, "true")),
        ("_reconstructor", Calls(copyreg._reconstructor, object, object, None)),
        ("add_extension", Calls(copyreg.add_extension, "os", "system", 7)),
        ("load", Calls(np.load, str(mark))), ("fromfile", Calls(np.fromfile, str(mark))),
        ("savetxt", Calls(np.savetxt, str(mark), [1])), ("memmap", Calls(np.memmap, str(mark), "f8", "w+", 0, (9,))),
        ("_loads", Calls(pickle._loads, b"N.")), ("found str; expected list", Calls(set, "abc")),
        ("expected bytes", Calls(bytes, 10**12)),
        ("_mareconstruct", np.ma.array([1.0])), ("recarray", np.zeros((1, 1)).view(np.recarray)),
        ("__generator_ctor", np.random.default_rng(0)), ("sin", np.sin), ("array of structures", np.zeros(1, "f8,i4")),
        ("M8", np.zeros(1, "M8[s]")), ("tuple as a key", {(1, 2): 3}), ("tuple as a key", {("a", 1 << 20): 3}),
        ("tuple as a key", {("a", (1,)): 3}), ("tuple as a key", {("a",) * 9: 3}), ("complex as a key", {1j}),
    ]  # fmt: skip


def test_what_is_more_than_values_is_refused_by_name_and_not_run(tmp_path):
    mark = tmp_path / "mark"
    assert len(attacks(mark)) > 25
    for refused, value in attacks(mark):
        for protocol in (0, 2, 4, 5):
            with pytest.raises(FileError, match=rf"some\.pkl.*{refused}"):
                read(tmp_path, pickle.dumps(value, protocol=protocol))
    assert [entry.name for entry in tmp_path.iterdir()] == ["some.pkl"]
    # Python's own unpickler does run them.
    pickle.loads(pickle.dumps(attacks(mark)[1][1]))  # noqa: S301
    assert mark.exists()


ARRAY = b"cnumpy._core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntC\x01btR"
FLOAT = b"cnumpy\ndtype\n(X\x02\x00\x00\x00f8tR(K\x03X\x01\x00\x00\x00<NNNtb"
OBJECT = FLOAT.replace(b"f8", b"O8").replace(b"<", b"|")


def state(shape, dtype, data):
    """An array with this state set."""
    return ARRAY + b"(K\x01" + shape + dtype + b"\x89" + data + b"tb."


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"Pos.system\n.", "the step PERSID"),
        (b"NQ.", "the step BINPERSID"),
        (b"\x82\x07.", "the step EXT1"),
        (b"(ios\nsystem\n.", "os.system"),
        (b"(cbuiltins\nset\no.", "the step OBJ"),
        (b"cbuiltins\nset\n)\x81.", "the step NEWOBJ"),
        (b"cbuiltins\nset\n)}\x92.", "the step NEWOBJ_EX"),
        (b"\x97.", "the step NEXT_BUFFER"),
        (b"}}b.", "state of a dict"),
        (b"cbuiltins\nset\n}b.", "state of a _Global"),
        (b"cbuiltins\nset\n.", "a global .* in the place of a value"),
        (b"cbuiltins\nset.__init__\n.", "builtins.set.__init__"),
        (b"cnumpy\nndarray\n(K\x05tR.", "only named"),
        (ARRAY + b".", "unfinished array"),
        (ARRAY.replace(b"ndarray", b"dtype") + b".", "the class numpy.dtype; expected numpy.ndarray"),
        (state(b"(K\x02t", FLOAT, b"C\x04abcd"), "has 16 bytes, and 4 are there"),
        (state(b"(K\x02t", FLOAT, b"]"), "found list; expected bytes"),
        (state(b"(J\xff\xff\xff\xfft", FLOAT, b"C\x00"), "not negative"),
        (state(b"(K\x01\x8a\x09" + b"\xff" * 8 + b"\x00t", FLOAT, b"C\x00"), "shape"),
        (state(b"(" + b"K\x01" * 33 + b"t", FLOAT, b"C\x08abcdefgh"), "33 dimensions"),
        (state(b"(X\x01\x00\x00\x002t", FLOAT, b"C\x00"), "whole numbers"),
        (state(b"(K\x02t", OBJECT, b"C\x10" + b"a" * 16), "found bytes; expected list"),
        (state(b"(K\x03t", OBJECT, b"]"), "cannot reshape"),
        (state(1500 * b"(" + b"K\x01t" + 1499 * b"t", FLOAT, b"C\x00"), "nested too deep"),
        (state(b"(K\x01t", FLOAT.replace(b"f8", b"V8"), b"C\x08abcdefgh"), "V8"),
        (state(b"(K\x01t", b"X\x02\x00\x00\x00f8", b"C\x08abcdefgh"), "found str; expected dtype"),
        (state(b"(K\x01t", FLOAT.replace(b"f8", b"U1"), b"C\x04\xff\xff\xff\x7f"), "invalid characters"),
        (state(b")", OBJECT, b"](cos\nsystem\ne"), "os.system"),
        (ARRAY + b"q\x00(K\x01K\x01\x85" + OBJECT + b"\x89]h\x00atb.", "unfinished|holds itself"),
        (b"]q\x00h\x00a.", "holds itself"),
        (b"}q\x00K\x01h\x00s.", "holds itself"),
    ],
)
def test_hostile_steps_and_states(tmp_path, data, message):
    copyreg.add_extension("os", "system", 7)
    try:
        copyreg._extension_cache[7] = os.system  # as any earlier use would leave it: no unpickler is asked then
        with pytest.raises(FileError, match=message):
            read(tmp_path, data)
    finally:
        copyreg.remove_extension("os", "system", 7)


BOMBS = {
    "a length of 4 GiB": b"\x80\x04B\xff\xff\xff\xffabc.",
    "a length of 8 EiB": b"\x80\x04\x8e" + b"\xff" * 7 + b"\x7fabc.",
    "a text of 8 EiB": b"\x80\x04\x8d" + b"\xff" * 7 + b"\x7fabc.",
    "a byte array of 1 TiB": b"\x80\x05\x96\x00\x00\x00\x00\x00\x01\x00\x00abc.",
    "a frame of 1 TiB": b"\x80\x04\x95\x00\x00\x00\x00\x00\x01\x00\x00N",
    "a number of 2 GiB": b"\x80\x02\x8b\xff\xff\xff\x7fabc.",
    "a number of 1 MB": b"\x80\x02\x8b\x00\x00\x10\x00" + b"\x01" * (1 << 20) + b".",
    "a number of 1 MB in decimals": b"L" + b"9" * (1 << 20) + b"L\n.",
    "twice a list, 60 times over": b"]" + b"".join(b"q%c](h%ch%ce" % (i, i, i) for i in range(60)) + b".",
    "a list a hundred thousand deep": b"]" * 100_000 + b"a" * 99_999 + b".",
    "a tuple a hundred thousand deep, as a key": b"})" + b"\x85" * 100_000 + b"Ns.",
    "too many values": b"](" + b"N" * 1_100_000 + b"e.",
    "an array of 2**62 values": state(b"(\x8a\x08" + b"\x00" * 7 + b"\x3ft", FLOAT, b"C\x08abcdefgh"),
    "an array of 2**50 empty texts": state(
        b"(\x8a\x08" + b"\x00" * 6 + b"\x04\x00t", FLOAT.replace(b"f8", b"U0"), b"C\x00"
    ),
    "a memo of 2**32 entries": b"Nr\xff\xff\xff\xff.",
}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_fizzle(tmp_path, name):
    before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
    if name == "a memo of 2**32 entries":  # a number like any other here; Python's own would take 64 GiB
        assert read(tmp_path, BOMBS[name]) is None
    else:
        with pytest.raises(FileError, match=r"some\.pkl"):
            read(tmp_path, BOMBS[name])
    assert time.monotonic() - started < 15
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 400_000  # kB


def test_what_is_no_pickle(tmp_path):
    whole = pickle.dumps({"image": np.arange(6.0), "x": [1, 2]})
    for data, message in [
        (b"", "not a pickle, or is damaged, at byte 0"), (b"hello world", "not a pickle"),
        (b"\x89HDF\r\n\x1a\n", "not a pickle"),
        (whole[:-1], "exhausted"), (whole[: len(whole) // 2], "damaged, at byte"), (b"\x80\x04.", "damaged"),
        (b"\x80\x04NN.", "damaged"), (b"\x80\x04h\x05.", "damaged"), (b"\x80\x04t.", "damaged"),
    ]:  # fmt: skip
        with pytest.raises(DamagedFileError, match=message):
            read(tmp_path, data)
    with pytest.raises(FileError, match="no such file"):
        read_pickle(tmp_path / "missing.pkl")


def test_mutated_pickles_end_in_values_or_in_an_error_of_ours(tmp_path):
    rng = np.random.default_rng(0)
    wholes = [pickle.dumps(plain_values(), protocol=protocol) for protocol in range(6)]
    beyond = 0
    for _ in range(MUTATIONS):
        data = bytearray(wholes[rng.integers(6)])
        for _ in range(rng.integers(1, 4)):
            place = int(rng.integers(2, len(data)))
            match rng.integers(4):
                case 0:
                    data[place] = rng.integers(256)
                case 1:
                    data[place : place + 4] = [b"\xff" * 4, b"\0" * 4, b"\1\0\0\0"][rng.integers(3)]
                case 2:
                    del data[place : place + rng.integers(1, 9)]
                case 3:
                    other = int(rng.integers(len(data)))
                    data[place:place] = data[other : other + rng.integers(1, 40)]
        reached = len(data)
        try:
            read(tmp_path, bytes(data))
        except FileError as error:
            reached = int(re.search(r"some\.pkl.* byte (\d+)", str(error))[1])
        beyond += reached > 100
    assert beyond > MUTATIONS / 2


@pytest.mark.slow
def test_a_large_file_may_hold_as_many_arrays_as_an_aperture_has_positions(tmp_path, monkeypatch):
    """As raw simulations do, whose channels are a list of arrays: more steps, by the size of the file.

    A tenth of such a file, with a tenth of its steps.
    """
    channels = [np.full(128, i, complex) for i in range(6_000)]
    (tmp_path / "channels.pkl").write_bytes(pickle.dumps(channels))
    size = (tmp_path / "channels.pkl").stat().st_size
    steps = sum(1 for _ in pickletools.genops((tmp_path / "channels.pkl").read_bytes()))
    assert limits_of(0).items // 10 < steps < limits_of(10 * size).items // 10

    def tenth(size):
        return limits_of(size)._replace(items=limits_of(10 * size).items // 10)

    monkeypatch.setattr("millisight.io.arrays._pickles.limits_of", tenth)
    found = read_pickle(tmp_path / "channels.pkl")
    assert len(found) == 6_000
    assert np.array_equal(found[-1], channels[-1])


def test_copies_that_calls_make_are_counted(tmp_path):
    """A megabyte that asks 8 000 times for its text as bytes took 8 GB."""
    text = b"x" * 1_000_000
    data = (
        b"\x80\x02](X" + struct.pack("<I", len(text)) + text + b"q\x01X\x06\0\0\0latin1q\x02c_codecs\nencode\nq\x03000"
    )
    data += b"h\x03h\x01h\x02\x86R" * 8000 + b"e."
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(FormatError, match=r"calls make \d+ bytes; expected at most \d+ of a file of this size"):
        read(tmp_path, data)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


@pytest.mark.slow
def test_a_long_list_is_looked_into_once(tmp_path):
    """However often it is held: 100 000 times 100 000 items took over a minute."""
    data = b"\x80\x02]q\x00(" + b"K\x01" * 100_000 + b"e0](" + b"h\x00" * 100_000 + b"e."
    began = time.perf_counter()
    with pytest.raises(FormatError, match="its shared parts counted each time"):
        read(tmp_path, data)
    assert time.perf_counter() - began < 10
