"""Damaged files against every reader: 100 000 of them with `make fuzz`, 2 000 in the test suite.

    python tests/fuzz/parsers.py --count 100000

A small valid file of each format is damaged by Hypothesis: bytes changed, cut out, doubled, moved, the end cut off,
numbers in text replaced by extreme ones. Whatever comes, a reader returns or raises one of millisight's own errors, in
bounded time and memory. Most damage falls behind the header, so that it is not refused at the door.
"""

import argparse
import json
import pickle
import re
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from millisight.core.errors import MillisightError

SECONDS = 10  # for one file
MEMORY = 256 << 20  # that the process may grow by in all


@dataclass(frozen=True)
class Format:
    """A format: how a valid file looks, how it is read, and how many of its first bytes are its header."""

    name: str
    valid: bytes
    parse: Callable[[Path], object]
    header: int
    text: bool = False
    rarely: int = 1  # so many times fewer files than of others: each starts a process


def formats(folder: Path) -> list[Format]:
    """Every format with a reader of its own."""
    from millisight.calibration import read_capture
    from millisight.datasets import read_manifest
    from millisight.io import load
    from millisight.io.arrays import array_shapes, read_arrays, read_pickle, read_table, read_touchstone
    from millisight.io.mito._setup import read_info
    from millisight.io.raw import (
        assemble_packets,
        describe_raw,
        read_dca1000,
        read_packets,
        read_position2go,
        read_robot_log,
        read_ti_config,
    )

    def bin_file(path: Path) -> None:
        describe_raw(path, samples=16, receivers=4, chirps=2)
        read_dca1000(path, samples=16, receivers=4, chirps=2)

    def arrays(path: Path) -> None:
        array_shapes(path)
        read_arrays(path)

    def manifest(path: Path) -> None:
        path.rename(folder / "manifest.jsonl")
        read_manifest(folder)

    rng = np.random.default_rng(0)
    make = _Maker(rng, folder)
    return [
        Format("dca1000", make.chirps(), bin_file, 0),
        Format("packets", make.packets(), lambda p: assemble_packets(read_packets(p)), 24),
        Format("ti config", CONFIG.encode(), read_ti_config, 0, text=True),
        Format("position2go", make.text(), lambda p: read_position2go(p, samples=8, chirps=2), 0, text=True),
        Format("npy", make.npy(), arrays, 10),
        Format("npz", make.npz(), arrays, 30),
        Format("mat", make.mat(), arrays, 128, rarely=20),
        Format("image pickle", make.pickled(2), read_pickle, 2),
        Format("camera pickle", make.pickled(4), read_pickle, 2),
        Format("old pickle", make.pickled(0), read_pickle, 1),
        Format("description", DESCRIPTION.encode(), lambda p: read_capture(p, data=folder), 0, text=True),
        Format("text table", TABLE.encode(), read_table, 0, text=True),
        Format("touchstone", TOUCHSTONE.encode(), read_touchstone, 0, text=True),
        Format("robot log", LOG.encode(), read_robot_log, 16, text=True),
        Format("experiment info", INFO.encode(), read_info, 1, text=True),
        Format("manifest", make.manifest(), manifest, 0, text=True),
        Format("hdf5", make.hdf5(), load, 8),
    ]


CONFIG = """\
% a comment
sensorStop
flushCfg
dfeDataOutputMode 1
channelCfg 15 1 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 7 6 60 0 0 58.6116 1 512 10000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
frameCfg 0 0 1 4000 3 1 0
lvdsStreamCfg -1 0 1 0
sensorStart
"""
LOG = "time,x,y,z,qx,qy,qz,qw\n" + "".join(f"{0.01 * i:.3f},{0.001 * i:.4f},{0.1:.3f},0.2,0,0,0,1\n" for i in range(40))
TABLE = "f;re;im\n" + "".join(f"{20 + 0.1 * i:.3f};{0.01 * i:.4f};1.5-2i\n" for i in range(40))
TOUCHSTONE = "! VNA\n# GHz S MA R 50\n" + "".join(f"{20 + 0.1 * i:.3f} 0.1 0 0.5 {i} 0.5 0 0.1 0\n" for i in range(40))
INFO = json.dumps({"aperture size": "normal", "rx offset": "x", "background": "tripod"})
DESCRIPTION = """\
title = "a plate"

[radar]
name = "scanner"
start_frequency = 22e9
stop_frequency = 22.5e9

[frames]
file = "cube.npz"
array = "data"
axes = ["sample", "-y", "x"]
phase_sign = 1

[positions]
raster = { step = [0.003, 0.003], center = [0, 0, 0] }

[calibration]
subtract_mean = true

[image]
lower = [-0.1, -0.1, -0.2]
upper = [0.1, 0.1, -0.2]
spacing = 0.002
"""


class _Maker:
    """Small valid files."""

    def __init__(self, rng: np.random.Generator, folder: Path):
        self.rng, self.folder = rng, folder
        with open(folder / "cube.npz", "wb") as file:
            np.savez(file, data=self.complex(6, 5, 4))

    def complex(self, *shape: int) -> np.ndarray:
        return (self.rng.normal(size=shape) + 1j * self.rng.normal(size=shape)).astype(np.complex64)

    def chirps(self) -> bytes:
        from millisight.io.raw import write_dca1000

        beat = np.exp(2j * np.pi * 0.2 * np.arange(16)) * np.array([900, 700, 500, 800])[:, None]
        frames = np.round(np.tile(beat, (12, 2, 1, 1)) + 20 * self.complex(12, 2, 4, 16))
        return self.written(lambda p: write_dca1000(p, frames), ".bin")

    def text(self) -> bytes:
        from millisight.io.raw import write_position2go

        return self.written(lambda p: write_position2go(p, np.round(500 * self.complex(3, 2, 2, 8))), ".txt")

    def packets(self) -> bytes:
        """A classic pcap file of five UDP packets."""
        out = bytearray(np.array([0xA1B2C3D4, 0x00040002, 0, 0, 65535, 1], "<u4").tobytes())
        for i in range(5):
            data = i.to_bytes(4, "little") + (64 * i).to_bytes(6, "little") + bytes(range(64))
            udp = (4098).to_bytes(2, "big") * 2 + (8 + len(data)).to_bytes(2, "big") + b"\0\0" + data
            ip = bytes([0x45, 0]) + (20 + len(udp)).to_bytes(2, "big") + bytes(5) + bytes([17]) + bytes(10) + udp
            frame = bytes(12) + b"\x08\x00" + ip
            out += np.array([i, 0, len(frame), len(frame)], "<u4").tobytes() + frame
        return bytes(out)

    def npy(self) -> bytes:
        stream = BytesIO()
        for array in (self.complex(3, 4, 2), np.float64(22e9), np.arange(6, dtype=np.uint16)):
            np.save(stream, array)
        return stream.getvalue()

    def npz(self) -> bytes:
        stream = BytesIO()
        np.savez_compressed(stream, data=self.complex(3, 4, 2), times=np.arange(5.0))
        return stream.getvalue()

    def mat(self) -> bytes:
        from scipy.io import savemat

        stream = BytesIO()
        savemat(stream, {"data": self.complex(3, 4, 2), "step": 0.003, "name": "scan", "s": {"a": np.arange(3)}})
        return stream.getvalue()

    def pickled(self, protocol: int) -> bytes:
        axes = {f"{name}_locs": np.linspace(0, 0.1, n) for name, n in zip("xyz", (4, 3, 2), strict=True)}
        image = {"image": self.complex(4, 3, 2), **axes, "antenna_locs": np.array(None, dtype=object)}
        return pickle.dumps({**image, "names": ["1707", "1708"], "created": [0.5, -1]}, protocol=protocol)

    def manifest(self) -> bytes:
        from millisight.datasets import Manifest, ManifestEntry, ManifestSource, write_manifest

        source = ManifestSource(path="004_sugar_box/a.pkl", size=10, sha256="0" * 64)
        entries = {
            name: ManifestEntry(path=name, kind="image", size=20, sha256="1" * 64, sources=(source,))
            for name in ("a.h5", "b.h5")
        }
        write_manifest(self.folder, Manifest(settings={"schema_version": 1}, entries=entries))
        return (self.folder / "manifest.jsonl").read_bytes()

    def hdf5(self) -> bytes:
        import millisight as ms

        image = ms.SarImage(grid=ms.VoxelGrid.regular((0, 0, 0), (0.03, 0.02, 0), 0.01), values=self.complex(4, 3, 1))
        return self.written(lambda p: ms.save(p, image), ".h5")

    def written(self, write: Callable[[Path], None], suffix: str) -> bytes:
        path = self.folder / f"valid{suffix}"
        write(path)
        return path.read_bytes()


EXTREME = ("0", "-1", "1e308", "-1e400", "nan", "inf", "99999999999999999999", "1e-320", '"', "", "[", "{", "true", "x")


def damaged(form: Format) -> st.SearchStrategy[bytes]:
    """The valid file with one to four pieces of damage, one in four of which may touch the header."""
    size = len(form.valid)
    anywhere = st.integers(0, max(size - 1, 0))
    behind = st.integers(min(form.header, size - 1), size - 1)
    place = st.one_of(behind, behind, behind, anywhere)
    edits = [
        st.tuples(st.just("set"), place, st.binary(min_size=1, max_size=8)),
        st.tuples(st.just("flip"), place, st.integers(0, 7)),
        st.tuples(st.just("cut"), place, st.integers(1, 64)),
        st.tuples(st.just("insert"), place, st.binary(min_size=1, max_size=32)),
        st.tuples(st.just("double"), place, st.integers(1, 200)),
        st.tuples(st.just("end"), place, st.none()),
        st.tuples(st.just("large"), place, st.sampled_from([b"\xff" * 4, b"\xff" * 8, b"\x7f\xff\xff\xff", bytes(8)])),
    ]
    if form.text:
        edits += [st.tuples(st.just("number"), place, st.sampled_from(EXTREME))] * 4
    return st.lists(st.one_of(edits), min_size=1, max_size=4).map(lambda chosen: apply(form.valid, chosen))


def apply(data: bytes, edits: list[tuple]) -> bytes:
    """`data` after the edits (kind, place, what)."""
    for kind, place, what in edits:
        at = min(place, len(data))
        if kind in ("set", "large"):
            data = data[:at] + what + data[at + len(what) :]
        elif kind == "flip" and at < len(data):
            data = data[:at] + bytes([data[at] ^ 1 << what]) + data[at + 1 :]
        elif kind == "cut":
            data = data[:at] + data[at + what :]
        elif kind == "insert":
            data = data[:at] + what + data[at:]
        elif kind == "double":
            data = data[: at + what] + data[at:]
        elif kind == "end":
            data = data[:at]
        elif kind == "number" and (found := re.compile(rb"[-+]?\d[\d.e+]*").search(data, at)):
            data = data[: found.start()] + what.encode() + data[found.end() :]
    return data


class Tally:
    """What came of the files."""

    def __init__(self) -> None:
        self.files, self.past_header, self.read = Counter(), Counter(), Counter()
        self.slowest = (0.0, "")

    def lines(self) -> list[str]:
        total, past = sum(self.files.values()), sum(self.past_header.values())
        rows = [
            f"{name:16} {n:7} files, {self.past_header[name]:7} with a whole header, {self.read[name]:7} read"
            for name, n in sorted(self.files.items())
        ]
        growth = f"slowest {self.slowest[0]:.2f} s ({self.slowest[1]})"
        return [*rows, f"{total} files, {past} past the header ({100 * past / max(total, 1):.0f} %); {growth}"]


def try_one(form: Format, data: bytes, folder: Path, tally: Tally) -> None:
    """Read one damaged file; anything but a result or an error of ours is a failure."""
    path = folder / f"damaged{_suffix(form)}"
    path.write_bytes(data)
    tally.files[form.name] += 1
    tally.past_header[form.name] += len(data) > form.header and data[: form.header] == form.valid[: form.header]
    began = time.perf_counter()
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        form.parse(path)
        tally.read[form.name] += 1
    except MillisightError:
        pass
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    tally.slowest = max(tally.slowest, (time.perf_counter() - began, form.name))


def _suffix(form: Format) -> str:
    suffixes = {"dca1000": ".bin", "packets": ".pcap", "ti config": ".cfg", "position2go": ".txt", "npy": ".npy"}
    suffixes |= {"npz": ".npz", "mat": ".mat", "description": ".toml", "robot log": ".csv", "experiment info": ".json"}
    suffixes |= {"text table": ".csv", "touchstone": ".s2p"}
    return suffixes.get(form.name, {"hdf5": ".h5", "manifest": ".jsonl"}.get(form.name, ".pkl"))


def run(count: int, number: int) -> Tally:
    """Read `count` damaged files in all.

    Raises
    ------
    Exception
        Whatever a reader raised that is none of millisight's errors; Hypothesis adds the smallest file that does so.
    """
    tally = Tally()

    def too_long(*_: object) -> None:
        raise TimeoutError(f"a reader took more than {SECONDS} s")

    signal.signal(signal.SIGALRM, too_long)
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        every = formats(folder)
        sound = Tally()
        for form in every:  # what is loaded with the first file is not the file's doing
            try_one(form, form.valid, folder, sound)
            if not sound.read[form.name]:
                raise RuntimeError(f"the valid {form.name} file is refused")
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (_address_space() + MEMORY, hard))
        try:
            share = count / sum(1 / form.rarely for form in every)
            for form in every:
                _check(form, int(share / form.rarely) + 1, number, folder, tally)
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    return tally


def _check(form: Format, count: int, number: int, folder: Path, tally: Tally) -> None:
    @seed(number)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(damaged(form))
    def read(data: bytes) -> None:
        try_one(form, data, folder, tally)

    read()


def _address_space() -> int:
    """Bytes of address space that the process has now."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return pages * resource.getpagesize()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for line in run(arguments.count, arguments.seed).lines():
        sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    main()
