"""Small valid files of every format that has a reader, how each is read, and files that were found to do harm.

`tests/fuzz/parsers.py` damages them.
"""

import copy
import hashlib
import json
import pickle
import re
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # helpers
import behind


@dataclass(frozen=True)
class Format:
    """A format: how a valid file looks, how it is read, and how many of its first bytes are its header."""

    name: str
    valid: bytes
    parse: Callable[[Path], object]
    header: int
    suffix: str = ".pkl"
    text: bool = False
    rarely: int = 1  # so many times fewer files than of others: each starts a process, or takes long
    found: tuple[bytes, ...] = ()  # files that did harm once


def formats(folder: Path) -> Iterator[Format]:
    """Every format with a reader of its own, made when it is asked for.

    Those whose readers start a process come first: a fork takes the longer the more is loaded, and torch is last.
    """
    make = _Maker(np.random.default_rng(0), folder)
    for some in (_arrays, _raw, _texts, _scenes, _networks):
        yield from some(make, folder)


def _arrays(make: "_Maker", _: Path) -> list[Format]:
    """Arrays, pickles and records."""
    from millisight.io import load, load_extras, read_photo
    from millisight.io.arrays import array_shapes, read_arrays, read_pickle, read_table, read_touchstone
    from millisight.io.mito import read_published
    from millisight.perception.training._bands import read_parts

    def arrays(path: Path) -> None:
        array_shapes(path)
        read_arrays(path)

    def record(path: Path) -> None:
        load(path)
        load_extras(path)

    def published(path: Path) -> None:
        read_published(path.replace(path.with_name("processed_image.pkl")))

    return [
        Format("npy", make.npy(), arrays, 10, ".npy"),
        Format("npz", make.npz(), arrays, 30, ".npz", found=(make.overlapping(),)),
        Format("mat", make.mat(), arrays, 128, ".mat", rarely=8),
        Format("image pickle", make.pickled(2), read_pickle, 2, found=make.bombs()),
        Format("camera pickle", make.pickled(4), read_pickle, 2),
        Format("old pickle", make.pickled(0), read_pickle, 1),
        Format("published image", make.image(), published, 2),
        Format(
            "text table",
            TABLE.encode(),
            read_table,
            0,
            ".csv",
            text=True,
            found=(b"1;2;3\n" + b"9" * 49_000 + b"x;3\n",),
        ),
        Format(
            "touchstone",
            TOUCHSTONE.encode(),
            read_touchstone,
            0,
            ".s2p",
            text=True,
            found=(b"#\n1 2 3", LOUD),
        ),
        Format("hdf5", make.hdf5(), record, 8, ".h5"),
        Format(
            "hdf5 attributes",
            *behind.attributes(make.folder),
            0,
            ".txt",
            text=True,
            rarely=10,
            found=(b"/|schema_version|inf",),
        ),
        Format("hdf5 unsealed", make.unsealed(), record, 8, ".h5", rarely=20),
        Format("scene to train on", make.parts(), lambda p: read_parts(p, "weights"), 30, ".npz", found=(b"", b"PK")),
        Format("photo", make.photo(), read_photo, 8, ".png", found=(make.photo_with_a_late_profile(),)),
    ]


def _raw(make: "_Maker", folder: Path) -> list[Format]:
    """What recorders write."""
    from millisight.io.mito import read_log
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
        describe_raw(path, samples=16, receivers=4, chirps=2)  # works out the order, which takes longest
        read_dca1000(path, samples=16, receivers=4, chirps=2, order="four-lane")

    def published_log(path: Path) -> None:
        raw = folder / "los" / "unprocessed" / "radars" / "77_ghz"
        (raw / "radar_data").mkdir(parents=True, exist_ok=True)
        path.replace(raw / "antenna.npz")
        read_log(raw, "77_ghz")

    return [
        Format("dca1000", make.chirps(), bin_file, 0, ".bin"),
        Format("packets", make.packets(), lambda p: assemble_packets(read_packets(p)), 24, ".pcap"),
        Format("ti config", CONFIG.encode(), read_ti_config, 0, ".cfg", text=True),
        Format("position2go", make.text(), lambda p: read_position2go(p, samples=8, chirps=2), 0, ".txt", text=True),
        Format(
            "robot log",
            LOG.encode(),
            read_robot_log,
            16,
            ".csv",
            text=True,
            found=(LOG.replace(",0,0,0,1", ",0,0,0,1e200").encode(),),
        ),
        Format("log of a row", *behind.log(folder), 30, ".npz", found=(b"", b"PK")),
        Format(
            "frames of a row",
            *behind.frames(folder),
            10,
            ".npy",
            found=(b"", b"PK", b"\x93NUMPY\x01\x00\x06\x00{'a.a\n", behind.saved_frames().replace(b"<c8", b",c8")),
        ),
        Format("published log", make.log(), published_log, 30, ".npz"),
    ]


def _texts(make: "_Maker", folder: Path) -> list[Format]:
    """Descriptions, recipes, worlds, lists and what a page sends."""
    from helpers import annotating, small_recipe
    from millisight.calibration import RadarCalibration, read_capture, read_poses
    from millisight.cli.segment import _read_prompts
    from millisight.core import record_from_file, sealed
    from millisight.core.errors import InputError
    from millisight.data._radar import _Preset
    from millisight.datasets import read_manifest
    from millisight.datasets._hub_card import _info
    from millisight.datasets._runner import _read_cached
    from millisight.datasets.generation import read_recipe
    from millisight.datasets.generation._ledger import JOURNAL_NAME, Ledger
    from millisight.io import save
    from millisight.io.mito._setup import read_info
    from millisight.perception import read_description
    from millisight.perception.training import SegmenterRecipe
    from millisight.rig import Lab
    from millisight.rig.virtual import World
    from millisight.viz.annotator import Annotation, open_picture

    def beside(name: str, read: Callable[[Path], object]) -> Callable[[Path], None]:
        """Reads a file that has to have this name in its folder."""

        def parse(path: Path) -> None:
            place = folder / f"{name}.folder"
            place.mkdir(exist_ok=True)
            path.replace(place / name)
            read(place)

        return parse

    def lying_behind(name: str, valid: bytes, parse: Callable[[Path], object]) -> Format:
        return Format(name, valid, parse, 1, ".json", text=True, found=(*JSON_BOMBS, *behind.JSON_BEYOND))

    save(folder / "annotated.h5", annotating.radar_image())
    subject, segmenters = open_picture(folder / "annotated.h5"), {"discs": annotating.Discs()}
    annotation = Annotation(subject, folder / "mask.h5", segmenters=segmenters)

    def page(path: Path) -> None:
        try:
            asked = json.loads(path.read_bytes())
        except (ValueError, RecursionError) as error:
            raise InputError("the server refuses what is no JSON") from error
        annotation.mask(asked)
        annotation.save(asked)

    asked = json.dumps({"method": "discs", "points": [[3, 4], [8, 9]], "positive": [True, False]})
    entry = {"path": "a.h5", "kind": "raw", "size": 3, "sha256": "0" * 64, "notes": []}
    entry["sources"] = [{"path": "truth/a/job.json", "size": 3, "sha256": "1" * 64, "files": 1}]
    cached = {"key": "k", "checksum": hashlib.sha256(b"1.5").hexdigest(), "result": 1.5}
    preset = (Path(sys.modules[_Preset.__module__].__file__ or "").parent / "presets" / "iwr1443.toml").read_bytes()
    weights = {"sha256": "0" * 64, "cut": 0.5, "classes": ["a", "b"], "calibration": {"open": {"temperature": 1.0}}}
    recipe = (Path(__file__).parents[2] / "examples" / "training" / "segmenter.toml").read_bytes()
    return [
        Format("description", DESCRIPTION.encode(), lambda p: read_capture(p, data=folder), 0, ".toml", text=True,
               found=(*TOML_BOMBS, re.sub("axes = .*", "axes = 1.5", DESCRIPTION).encode())),
        Format("experiment info", INFO.encode(), read_info, 1, ".json", text=True, found=JSON_BOMBS),
        Format("manifest", make.manifest(), beside("manifest.jsonl", read_manifest), 0, ".jsonl", text=True,
               found=JSON_BOMBS),
        Format("recipe", small_recipe.TEXT.encode(), read_recipe, 0, ".toml", text=True, found=TOML_BOMBS),
        Format("training recipe", recipe, lambda p: record_from_file(SegmenterRecipe, p), 0, ".toml", text=True,
               found=TOML_BOMBS),
        Format("world", WORLD.encode(), World.from_toml, 0, ".toml", text=True, found=TOML_BOMBS),
        Format("rig", RIG.encode(), Lab.from_toml, 0, ".toml", text=True, found=TOML_BOMBS),
        Format("calibration", CALIBRATION.encode(), lambda p: record_from_file(RadarCalibration, p, "a calibration"), 0,
               ".toml", text=True, found=TOML_BOMBS),
        Format("poses", POSES.encode(), beside("poses.toml", read_poses), 0, ".toml", text=True,
               found=(*TOML_BOMBS, POSES.replace("0.0, 1.0]", "1e200, 1.0]").encode())),
        Format("radar", preset, lambda p: record_from_file(_Preset, p, "a radar"), 0, ".toml", text=True,
               found=TOML_BOMBS),
        Format("journal", f"{sealed(json.dumps([entry]))}\n".encode(), beside(JOURNAL_NAME, lambda p: Ledger(p, {})), 1,
               ".jsonl", text=True, found=(*JSON_BOMBS, sealed('[{"path": ["a"], "sources": []}]').encode())),
        Format("checksum cache", *behind.checksums(folder), 1, ".json", text=True, found=JSON_BOMBS),
        Format("result cache", json.dumps(cached).encode(), lambda p: _read_cached(p, "k"), 1, ".json", text=True,
               found=JSON_BOMBS),
        Format("card facts", b'{"simulated": true, "physics": "points"}', _info, 1, ".json", text=True,
               found=JSON_BOMBS),
        Format("prompts", asked.encode(), _read_prompts, 1, ".json", text=True, found=JSON_BOMBS),
        Format("annotator page", asked.encode(), page, 1, ".json", text=True, found=JSON_BOMBS),
        lying_behind("annotation", *behind.prompts(folder, subject, segmenters)),
        lying_behind("rows of a scan", *behind.rows(folder)),
        lying_behind("raw settings", *behind.settings(folder, make.chirps())),
        Format("weights' description", json.dumps(weights).encode(), lambda p: read_description(p, "cut"), 1, ".json",
               text=True, found=JSON_BOMBS),
    ]  # fmt: skip


def _scenes(make: "_Maker", _: Path) -> list[Format]:
    """Meshes and point clouds."""
    from millisight.io import holds_points, read_point_cloud
    from millisight.meshes import load_mesh

    def cloud(path: Path) -> None:
        holds_points(path)
        read_point_cloud(path)

    def mesh(path: Path) -> object:
        return load_mesh(path, unit="m")

    return [
        Format("points", make.cloud(True), cloud, 60, ".ply", found=(b"ply\nformat ascii 1.0\nelement vertex -5\n",)),
        Format("points as text", make.cloud(False), cloud, 40, ".ply", text=True),
        Format("stl", make.mesh("stl"), mesh, 84, ".stl"),
        Format("ply", make.mesh("ply"), mesh, 60, ".ply"),
        Format("off", make.mesh("off"), mesh, 4, ".off", text=True),
        Format("obj", make.mesh("obj"), mesh, 0, ".obj", text=True),
        Format("glb", make.mesh("glb"), mesh, 20, ".glb", found=make.large_glb()),
    ]


def _networks(make: "_Maker", folder: Path) -> Iterator[Format]:
    """Weights and checkpoints, where what reads them is installed: onnx, or torch."""
    from millisight.perception import open_network, run_network
    from millisight.perception._onnx_nodes import operators

    with suppress(ImportError):
        import onnx

        def network(path: Path) -> None:
            content = path.read_bytes()
            session = open_network(path, hashlib.sha256(content).hexdigest(), needed_by="this", channels=3)
            run_network(session, np.zeros((2, 3), np.float32))

        valid = make.network(onnx)
        operators(valid)
        bad = valid.replace(b"\n\x03\x12\x01n", b"\n\x03\x12\x01\xff")  # a dimension's name, no UTF-8
        yield Format("network", valid, network, 8, ".onnx", rarely=4, found=(bad,))
    with suppress(ImportError):
        import torch

        yield from _torch_files(make, folder, torch)


def _torch_files(make: "_Maker", folder: Path, torch: Any) -> list[Format]:
    """A checkpoint, and weights as torch itself saves them, now and before its files were archives."""
    from millisight.perception.training._loop import read_checkpoint, write_checkpoint
    from millisight.perception.training.networks import read_released

    layer = torch.nn.Linear(3, 2)
    optimizer = torch.optim.AdamW(layer.parameters())
    weights = {f"network/{name}": value for name, value in layer.state_dict().items()}
    checkpoints = []
    for losses in ([0.5, 0.25], [10**400]):
        write_checkpoint(folder / "valid.safetensors", weights, {"made_of": "this", "losses": losses})
        checkpoints.append((folder / "valid.safetensors").read_bytes())

    def checkpoint(path: Path) -> None:
        read_checkpoint(path, "this", layer, optimizer, lambda _, state: [float(one) for one in state["losses"]])

    def released(path: Path) -> None:
        small = mock.patch(
            "millisight.perception.training.networks._released.ReleasedNetwork", partial(torch.nn.Linear, 3)
        )
        with small:  # the network itself takes seconds to make
            read_released(path, 2)

    return [
        Format("checkpoint", checkpoints[0], checkpoint, 8, ".safetensors", rarely=2, found=(checkpoints[1],)),
        Format("released", make.weights(torch, zipped=True), released, 4, ".pth"),
        Format("released before", make.weights(torch, zipped=False), released, 2, ".pth", found=(make.endless(torch),)),
    ]


POSES = """\
distortion = [0.1, -0.2]
[intrinsics]
fx = 618.2
fy = 617.8
cx = 321.3
cy = 241.1
width = 640
height = 480
[[pictures]]
file = "001.png"
position = [0.4, 0.0, 0.3]
orientation = [0.0, 0.0, 0.0, 1.0]
"""
LONG = "1" * 4301
TOML_BOMBS = (
    b"a." * 40_000 + b"a = 1",
    b"[" + b"a." * 40_000 + b"a]",
    rb'"\"".' * 26_000 + b"a = 1",
    b"a = " + b"[" * 100_000,
    f"seed = {1 << 64}".encode(),
    f"seed = {LONG}".encode(),
    b"objects = " + b"[" * 900 + b"]" * 900,
)
JSON_BOMBS = (
    b"[" * 100_000,
    b'{"a":' * 100_000,
    LONG.encode(),
    b'{"points": [[' + LONG.encode() + b', 1]], "positive": [true], "size": 1e999}',
    b'["a"]',
    b"null",
    b"NaN",
    b"\xff\xfe",
)
RIG = """\
layout = "captures"
[image]
lower = [-0.1, -0.1, -0.4]
upper = [0.1, 0.1, -0.2]
spacing = [0.01, 0.01, 0.01]
[scan]
size = [0.1, 0.1]
row_spacing = 0.02
[arm]
driver = "grbl"
serial = "/dev/null"
limits = { lower = [0.0, -1.0, 0.0], upper = [1.0, 1.0, 1.0] }
[[radars]]
driver = "dca1000"
name = "60_ghz"
start_file = "go.txt"
frame_period = 0.02
receivers = [[0.005, 0.0, 0.0]]
"""
CALIBRATION = """\
radar = "iwr1443"
path_offset = 0.15
path_offset_uncertainty = 0.0005
amplitudes = [[1.1, 0.9]]
phases = [[0.0, -2.5]]
offset = [0.005, -0.004, 0.003]
turn_deg = [0.0, 0.1, 0.2]
undetermined = ["turn about x"]
"""
WORLD = """\
objects = [{ object = "mug", at = [0.06, 0.07] }]
[scan]
size = [0.1, 0.1]
row_spacing = 0.02
[arm]
speed = 0.5
[[radars]]
preset = "position2go"
frame_period = 0.02
"""
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
LOUD = b"# Hz S DB R 50\n1 1e308 0 0 0 0 0 0 0\n"  # a level beyond all numbers
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
        frames = np.round(np.tile(beat, (3, 2, 1, 1)) + 20 * self.complex(3, 2, 4, 16))
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

    def image(self) -> bytes:
        import millisight as ms
        from millisight.io.mito import write_published

        grid = ms.VoxelGrid.regular((0, 0, 0), (0.03, 0.02, 0.01), 0.01)
        image = ms.SarImage(grid=grid, values=self.complex(4, 3, 2))
        path = self.folder / "processed_image.pkl"
        write_published(path, image, {"antenna_locs": self.rng.normal(size=(5, 3))})
        return path.read_bytes()

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

    def unsealed(self) -> bytes:
        """As versions before the seal wrote it. What hangs the library, for seconds, is in tests/io/test_opened.py."""
        import h5py

        (self.folder / "old.h5").write_bytes(self.hdf5())
        with h5py.File(self.folder / "old.h5", "r+") as file:
            file.attrs["schema_version"] = 1
        return (self.folder / "old.h5").read_bytes()

    def parts(self) -> bytes:
        from millisight.perception.training._bands import BANDS, write_parts

        images = {band: self.complex(2, 4, 3) for band in BANDS}
        return self.written(lambda p: write_parts(p, images, weights=np.arange(3.0)), ".npz")

    def photo(self) -> bytes:
        from PIL import Image

        stream = BytesIO()
        Image.fromarray(self.rng.integers(0, 255, (12, 16, 3), dtype=np.uint8)).save(stream, "PNG")
        return stream.getvalue()

    def photo_with_a_late_profile(self) -> bytes:
        """An empty one, behind the pixels, where Pillow expects none."""
        png = self.photo()
        return png[:-12] + struct.pack(">I4sI", 0, b"iCCP", zlib.crc32(b"iCCP")) + png[-12:]

    def log(self) -> bytes:
        stream = BytesIO()
        poses = np.concatenate([self.rng.normal(size=(20, 3)), np.tile([0, 0, 0, 1.0], (20, 1))], axis=1)
        np.savez(stream, times_77=1.7e9 + np.arange(20) / 100, tx_77_locs=poses)
        return stream.getvalue()

    def overlapping(self) -> bytes:
        """Members that are one: the directory names the first of them 6 000 times."""
        stream = BytesIO()
        with zipfile.ZipFile(stream, "w") as archive:
            content = BytesIO()
            np.save(content, np.zeros(1 << 16, np.uint8))
            archive.writestr("a.npy", content.getvalue())
            for _ in range(6000):
                archive.filelist.append(copy.copy(archive.filelist[0]))
        return stream.getvalue()

    def bombs(self) -> tuple[bytes, ...]:
        """Pickles that took gigabytes, or more than a minute."""
        text = b"x" * 1_000_000
        copies = b"\x80\x02](X" + struct.pack("<I", len(text)) + text + b"q\x01X\x06\0\0\0latin1q\x02"
        copies += b"c_codecs\nencode\nq\x03000" + b"h\x03h\x01h\x02\x86R" * 8000 + b"e."
        shared = b"\x80\x02]q\x00(" + b"K\x01" * 60_000 + b"e0](" + b"h\x00" * 60_000 + b"e."
        deep = b"\x80\x02" + b"]" * 60_000 + b"a" * 59_999 + b"."
        return copies, shared, deep

    def cloud(self, binary: bool) -> bytes:
        from millisight.data import PointCloud
        from millisight.io import write_point_cloud

        points = PointCloud(points=self.rng.normal(size=(20, 3)), magnitude=self.rng.random(20))
        return self.written(lambda p: write_point_cloud(p, points, binary=binary), ".ply")

    def mesh(self, suffix: str) -> bytes:
        import trimesh

        made: Any = trimesh.creation.icosphere(subdivisions=0, radius=0.05)
        exported = made.export(file_type=suffix)
        return exported if isinstance(exported, bytes) else exported.encode()

    def large_glb(self) -> tuple[bytes, ...]:
        """Vertices that nothing stores; nodes in a circle."""
        whole = self.mesh("glb")
        length = int.from_bytes(whole[12:16], "little")
        content, data = json.loads(whole[20 : 20 + length]), whole[20 + length :]
        made = []
        for change in ({"count": 10**9}, {"count": -1}, {"count": 10**30}, {"bufferView": None, "count": 10**8}):
            changed = copy.deepcopy(content)
            changed["accessors"][0] = {k: v for k, v in {**changed["accessors"][0], **change}.items() if v is not None}
            made.append(changed)
        made.append({**content, "nodes": [{"children": [0], "mesh": 0}]})
        made.append({**content, "nodes": [{"children": [i + 1]} for i in range(5000)] + [{"mesh": 0}]})
        files = []
        for one in made:
            text = json.dumps(one).encode()
            text += b" " * (-len(text) % 4)
            body = struct.pack("<I", len(text)) + b"JSON" + text + data
            files.append(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)
        return tuple(files)

    def network(self, onnx: Any) -> bytes:
        """An ONNX network that doubles its input."""
        two = onnx.numpy_helper.from_array(np.array([2], np.float32), "two")
        one = onnx.helper.make_tensor_value_info
        graph = onnx.helper.make_graph(
            [onnx.helper.make_node("Mul", ["x", "two"], ["y"])], "doubler",
            [one("x", onnx.TensorProto.FLOAT, ("n", 3))], [one("y", onnx.TensorProto.FLOAT, ("n", 3))], [two],
        )  # fmt: skip
        opset = [onnx.helper.make_opsetid("", 17)]
        return onnx.helper.make_model(graph, ir_version=8, opset_imports=opset).SerializeToString()

    def weights(self, torch: Any, *, zipped: bool) -> bytes:
        stream = BytesIO()
        torch.save(torch.nn.Linear(3, 2).state_dict(), stream, _use_new_zipfile_serialization=zipped)
        return stream.getvalue()

    def endless(self, torch: Any) -> bytes:
        """A name of 40 kB, in which torch searched for 16 s."""
        return self.weights(torch, zipped=False).replace(b"_rebuild_tensor_v2", b"_r" + b"a." * 20_000)

    def written(self, write: Callable[[Path], None], suffix: str) -> bytes:
        path = self.folder / f"valid{suffix}"
        write(path)
        return path.read_bytes()
