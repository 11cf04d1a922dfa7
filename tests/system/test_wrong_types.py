"""Every argument of every public function, given what it cannot be: an error of ours, or a result.

All 8 000 calls take a minute: where MILLISIGHT_PART is set, as in CI, an eighth of them is run, of each argument
others.
"""

import inspect
import os
import warnings
from collections.abc import Iterator
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import pytest

import millisight as ms
from helpers import solid_mirrors
from millisight.core.errors import MillisightError


class Unread:
    """What NumPy cannot read."""

    def __float__(self):
        raise ZeroDivisionError


ODD = {
    "None": None, "text": "x", "bytes": b"x", "minus one": -1, "zero": 0, "a half": 1.5, "nan": float("nan"),
    "infinite": float("inf"), "endless": 10**400, "true": True, "list": [], "dictionary": {}, "zeros": np.zeros(3),
    "no rows": np.zeros((0, 3)), "nan rows": np.full((2, 3), np.nan), "object": object(), "surrogate": "\ud800",
    "NUL": "a\0b", "imaginary": 1j, "masked": np.ma.masked, "ragged": [[1], [1, 2]], "unread": [Unread()],
    "class": int, "set": {1}, "shape": np.zeros((2, 2), object), "complex": np.complex64(1 + 5j), "absurd": 1e308,
    "denormal": 1e-320, "duration": np.timedelta64(1, "s"), "half": np.float16(2), "no number": Unread(),
}  # fmt: skip


class Call(NamedTuple):
    """A public function, and arguments with which it works."""

    function: Any
    arguments: tuple[Any, ...]
    named: dict[str, Any] | None = None


@pytest.fixture(scope="module")
def calls(tmp_path_factory) -> dict[str, Call]:
    folder = tmp_path_factory.mktemp("types")
    capture = solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.02, step=0.01)
    grid = ms.VoxelGrid.regular((-0.02, -0.02, -0.01), (0.02, 0.02, 0.01), 0.01)
    image = ms.form_image(capture, grid)
    inside = np.zeros(grid.xy.shape, bool)
    inside[1:3, 1:3] = True
    mask = ms.Mask(grid_xy=grid.xy, inside=inside)
    ms.save(folder / "mask.h5", mask)
    places = np.random.default_rng(0).normal(size=(30, 3))
    points = ms.PointCloud(
        points=places / 20, magnitude=np.ones(30), normals=places / np.linalg.norm(places, axis=1, keepdims=True)
    )
    ms.write_point_cloud(folder / "points.ply", points)
    scene = ms.Scene.from_mesh("golf_ball", vertices=100)
    some = {
        "form_image": (capture, grid), "simulate": (scene, capture.radar, capture.trajectory),
        "locate": (points, [("ball", scene.mesh)]), "surface_points": (capture, grid), "surface": (points,),
        "segment": (image,), "segment_instances": (image,), "classify": (image, mask),
        "sampling": (capture.trajectory, grid),
        "grid_around": (capture,), "autofocus": (capture, grid), "combine": (image, image, (0.5, 0.5)),
        "image_at": (
            capture.frames, capture.tx_positions, capture.rx_positions, capture.radar.waveform.frequencies, places
        ),
        "project": (image,), "f_score": (places, places, 0.1), "align": (places, places),
        "point_cloud": (image,), "aperture_over": (scene, capture.radar),
        "check_coverage": (scene, capture.trajectory), "extend_mask": (mask, image),
        "save": (folder / "saved.h5", mask), "load": (folder / "mask.h5",),
        "open_capture": (folder / "mask.h5",), "read_point_cloud": (folder / "points.ply",),
        "write_point_cloud": (folder / "written.ply", points), "segmenter": ("classical",), "classifier": (),
        "read_capture": (folder / "none.toml",), "read_scan": (folder / "none.toml",), "evaluate": ("pose", folder),
    }  # fmt: skip
    mesh, intrinsics = scene.mesh, ms.Intrinsics(fx=5.0, fy=5.0, cx=2.0, cy=2.0, width=5, height=4)
    pose = {
        "name": "a", "rotation": np.eye(3), "translation": np.zeros(3), "middle": np.zeros(3),
        "covariance": np.eye(6) / 1e6, "free_axes": (), "score": 1.0, "explained": 0.5, "shown": 0.5,
    }  # fmt: skip
    row = ms.ScanRow(times=np.arange(3.0), read=lambda: None, source="row")
    places_of = {"rgb": np.zeros((4, 5, 3), np.uint8), "depth": np.ones((4, 5), np.uint16), "pose": np.eye(4)}
    records = {
        "AntennaArray": {"tx_positions": np.zeros((1, 3)), "rx_positions": np.ones((1, 3))},
        "CameraFrame": {**places_of, "intrinsics": intrinsics},
        "Capture": {"radar": capture.radar, "trajectory": capture.trajectory, "frames": capture.frames},
        "Instances": {"grid_xy": grid.xy, "labels": np.zeros(grid.xy.shape, int), "scores": ()},
        "Intrinsics": {"fx": 5.0, "fy": 5.0, "cx": 2.0, "cy": 2.0, "width": 5, "height": 4},
        "Located": {"poses": [ms.Pose(**pose)], "probabilities": {"a": 1.0, "none of them": 0.0}, "points": points},
        "Material": {"name": "m"}, "PixelGrid": {"x": np.arange(3.0), "y": np.arange(3.0)}, "Pose": pose,
        "Prediction": {"probabilities": [0.5, 0.5], "class_names": ("a", "b")},
        "Prompts": {"points": [[1, 2]], "positive": [True]},
        "RawScan": {"radar": capture.radar, "rows": [row], "log": ms.Trajectory(times=[0, 1], positions=np.eye(3)[:2])},
        "ScanRow": {"times": np.arange(3.0), "read": lambda: None, "source": "x"},
        "Scene": {"objects": scene.objects}, "Surface": {"mesh": mesh, "sigma": np.ones(len(mesh.vertices))},
        "Trajectory": {"times": np.arange(3.0), "positions": np.zeros((3, 3))},
        "TriangleMesh": {"vertices": mesh.vertices, "faces": mesh.faces},
        "VoxelGrid": {"x": np.arange(3.0), "y": np.arange(3.0), "z": np.arange(3.0)},
        "Waveform": {"start_frequency": 77e9, "slope": 6e13, "sample_rate": 5e6, "samples_per_chirp": 8},
    }  # fmt: skip
    for name, given in records.items():
        getattr(ms, name)(**given)
    found = {name: Call(getattr(ms, name), (), given) for name, given in records.items()}
    found |= {name: Call(getattr(ms, name), arguments) for name, arguments in some.items()}
    return found | {
        "power_prompts": Call(ms.power_prompts, (ms.project(image),), {"rng": 0}),
        "add_noise": Call(ms.add_noise, (capture,), {"snr_db": 10, "rng": 0}),
        "Trajectory.raster": Call(ms.Trajectory.raster, (), {"size": (0.02, 0.02), "step": 0.01}),
        "Radar.preset": Call(ms.Radar.preset, ("mito-sim-24ghz",)),
        "Scene.from_mesh": Call(ms.Scene.from_mesh, ("golf_ball",), {"vertices": 100}),
        "VoxelGrid.regular": Call(ms.VoxelGrid.regular, ((0, 0, 0), (0.01, 0.01, 0.01), 0.01)),
    }


def odd_calls(calls: dict[str, Call]) -> Iterator[tuple[str, Any]]:
    for name, (function, arguments, given_by_name) in calls.items():
        for i, parameter in enumerate(inspect.signature(function).parameters.values()):
            if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD) or parameter.name == "progress":
                continue
            for what, odd in ODD.items():
                if isinstance(parameter.default, bool) and isinstance(odd, np.ndarray):
                    continue  # what is true of an array is Python's own question
                given, named = list(arguments), dict(given_by_name or {})
                if i < len(given) and parameter.kind != parameter.KEYWORD_ONLY:
                    given[i] = odd
                else:
                    named[parameter.name] = odd
                yield f"{name}({parameter.name}={what})", (function, given, named)


def test_what_an_argument_cannot_be_is_an_error_of_ours(calls, tmp_path, monkeypatch):
    """Without NumPy's warnings, too."""
    monkeypatch.chdir(tmp_path)  # some names are good ones: "x" is written
    failed = []
    part = int(os.environ.get("MILLISIGHT_PART") or 0)  # of eight: see conftest.py
    for what, (function, given, named) in islice(odd_calls(calls), max(part - 1, 0), None, 8 if part else 1):
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            try:
                function(*given, **named)
            except MillisightError:
                pass
            except Exception as error:
                if type(error).__name__ == "TypeCheckError":
                    continue  # of the tests' own check of annotations, before the function is reached
                failed.append(f"{what}: {type(error).__name__}: {error}")
    assert not failed, "\n".join(failed)
