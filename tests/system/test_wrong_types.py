"""Every argument of every public function, given what it cannot be: an error of ours, or a result."""

import inspect
import warnings
from collections.abc import Iterator
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
    "range": range(10**9), "class": int, "set": {1}, "shape": np.zeros((2, 2), object),
}  # fmt: skip


class Call(NamedTuple):
    """A public function, and arguments with which it works."""

    function: Any
    arguments: tuple[Any, ...]


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
    points = ms.PointCloud(points=places / 20, magnitude=np.ones(30), normals=places / np.linalg.norm(places, axis=1, keepdims=True))
    ms.write_point_cloud(folder / "points.ply", points)
    scene = ms.Scene.from_mesh("golf_ball", vertices=100)
    some = {
        "form_image": (capture, grid), "simulate": (scene, capture.radar, capture.trajectory),
        "locate": (points, [("ball", scene.mesh)]), "surface_points": (capture, grid), "surface": (points,),
        "segment": (image,), "segment_instances": (image,), "classify": (image, mask), "sampling": (capture.trajectory, grid),
        "grid_around": (capture,), "image_at": (capture, np.zeros((2, 3))), "autofocus": (capture, grid), "combine": (),
        "power_prompts": (image,), "project": (image,), "f_score": (places, places), "align": (places, places),
        "point_cloud": (image,), "add_noise": (capture,), "aperture_over": (scene,),
        "check_coverage": (scene, capture.trajectory), "extend_mask": (mask, image), "estimate_clock": (capture,),
        "retime": (capture,), "save": (folder / "saved.h5", mask), "load": (folder / "mask.h5",),
        "open_capture": (folder / "mask.h5",), "read_point_cloud": (folder / "points.ply",),
        "write_point_cloud": (folder / "written.ply", points), "segmenter": ("classical",), "classifier": (),
        "read_capture": (folder / "none.toml",), "read_scan": (folder / "none.toml",), "evaluate": ("pose", folder),
    }  # fmt: skip
    found = {name: Call(getattr(ms, name), arguments) for name, arguments in some.items()}
    return found | {
        "Trajectory.raster": Call(ms.Trajectory.raster, ((0.02, 0.02), 0.01)),
        "Radar.preset": Call(ms.Radar.preset, ("mito-sim-24ghz",)),
        "Scene.from_mesh": Call(ms.Scene.from_mesh, ("golf_ball",)),
        "VoxelGrid.regular": Call(ms.VoxelGrid.regular, ((0, 0, 0), (0.01, 0.01, 0.01), 0.01)),
    }


def odd_calls(calls: dict[str, Call]) -> Iterator[tuple[str, Any]]:
    for name, (function, arguments) in calls.items():
        for i, parameter in enumerate(inspect.signature(function).parameters.values()):
            if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                continue
            for what, odd in ODD.items():
                given, named = list(arguments), {}
                if i < len(given) and parameter.kind != parameter.KEYWORD_ONLY:
                    given[i] = odd
                else:
                    named[parameter.name] = odd
                yield f"{name}({parameter.name}={what})", (function, given, named)


def test_what_an_argument_cannot_be_is_an_error_of_ours(calls):
    """Without NumPy's warnings, too. A TypeError is Python's own for arguments that are missing."""
    failed = []
    for what, (function, given, named) in odd_calls(calls):
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            try:
                function(*given, **named)
            except MillisightError:
                pass
            except Exception as error:
                if "required positional argument" not in str(error):
                    failed.append(f"{what}: {type(error).__name__}: {error}")
    assert not failed, "\n".join(failed)
