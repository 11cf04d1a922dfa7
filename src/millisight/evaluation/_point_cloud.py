"""Point clouds of radar images: the centres of the voxels above a threshold; and as PLY and PCD files."""

import os
from pathlib import Path

import numpy as np

from millisight.core import atomic_path, checked_number, checked_path, checked_record
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import PointCloud, SarImage

CLOUD_SUFFIXES = (".ply", ".pcd")


def point_cloud(image: SarImage, threshold: float = 0.3, *, relative: bool = True, flat: bool = False) -> PointCloud:
    """The centres of the voxels with |I| > tau_P (paper, section "Simulation Accuracy").

    Parameters
    ----------
    image : SarImage
    threshold : tau_P; `relative`, a share of the largest |I|, else in the image's own unit
    flat : of the mean of |I| along z, all points at z = 0: for images without resolution in depth

    Returns
    -------
    PointCloud
        Without points where the image is zero, or nowhere above an absolute threshold.

    Raises
    ------
    InputError
        The threshold is negative, or relative and not below 1.
    """
    grid = checked_record(image, SarImage, name="image").grid
    if not flat:
        axes, values = (grid.x, grid.y, grid.z), image.magnitude
    else:
        axes, values = (grid.x, grid.y, np.zeros(1)), image.project("z")[..., None]
    return _cloud(axes, values, threshold, relative)


def _cloud(axes: tuple[np.ndarray, ...], values: np.ndarray, threshold: float, relative: bool) -> PointCloud:
    threshold = checked_number(threshold, name="threshold", minimum=0)
    if relative and not threshold < 1:
        raise InputError(f"threshold is {threshold:g}; expected less than 1, a share of the image's maximum")
    where = np.nonzero(values > (threshold * values.max() if relative else threshold))
    points = np.stack([axis[i] for axis, i in zip(axes, where, strict=True)], axis=-1)
    return PointCloud(points=points, magnitude=values[where])


def write_point_cloud(path: str | os.PathLike[str], cloud: PointCloud, *, binary: bool = True) -> None:
    """Write a cloud as PLY or PCD, by the suffix: x, y, z as doubles [m] and `intensity`, |I|, as a float.

    Raises
    ------
    UnknownNameError
        The suffix is neither .ply nor .pcd.
    FileError
        The file cannot be written.
    """
    path = checked_path(path)
    suffix = path.suffix.lower()
    if suffix not in CLOUD_SUFFIXES:
        raise UnknownNameError("point cloud format", suffix or Path(path).name, CLOUD_SUFFIXES)
    rows = np.empty(len(cloud), dtype=[("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("intensity", "<f4")])
    for i, name in enumerate("xyz"):
        rows[name] = cloud.points[:, i]
    rows["intensity"] = cloud.magnitude
    header = (_ply_header if suffix == ".ply" else _pcd_header)(len(cloud), binary)
    body = (
        rows.tobytes() if binary else "".join(f"{x!r} {y!r} {z!r} {v:.9g}\n" for x, y, z, v in rows.tolist()).encode()
    )
    with atomic_path(path) as temporary:
        temporary.write_bytes(header.encode("ascii") + body)


def _ply_header(count: int, binary: bool) -> str:
    properties = "".join(f"property double {name}\n" for name in "xyz")
    return (
        f"ply\nformat {'binary_little_endian' if binary else 'ascii'} 1.0\ncomment in metres, made by millisight\n"
        f"element vertex {count}\n{properties}property float intensity\nend_header\n"
    )


def _pcd_header(count: int, binary: bool) -> str:
    return (
        "# .PCD v0.7 - in metres, made by millisight\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 8 8 8 4\nTYPE F F F F\n"
        f"COUNT 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\n"
        f"DATA {'binary' if binary else 'ascii'}\n"
    )
