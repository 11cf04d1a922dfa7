"""Options that several commands share."""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated

import typer

from millisight.core import check_known
from millisight.core.errors import InputError
from millisight.io.mito import SIGHTS

_SAM_DEVICES = ("cpu", "cuda")

# Commands on images or captures

Images = Annotated[
    list[Path],
    typer.Argument(
        metavar="IMAGE",
        help="Image files: HDF5 as written by `millisight image`, or processed_image*.pkl of the published dataset; "
        "or folders, which are searched for both.",
    ),
]
DataFolder = Annotated[
    Path | None, typer.Option("--data", help="Folder of the files named in a description. [default: its own folder]")
]
SheetClutter = Annotated[str, typer.Option(help="lid or auto: take lids and cloths over the object off before; none.")]
SupportHeight = Annotated[
    str | None,
    typer.Option(
        "--support",
        help="Height of what the object lies on, in the frame of the capture, such as -30cm. [default: unknown]",
    ),
]
FalseAlarms = Annotated[float, typer.Option(help="Probability that a voxel of noise alone is taken for a surface.")]
RadarChoice = Annotated[
    str | None,
    typer.Option(help="Use only this radar of each experiment: 77_ghz or 24_ghz. A file of another one is refused."),
]
Multispectral = Annotated[
    bool, typer.Option("--multispectral", help="Pair each 77 GHz image of an experiment with its 24 GHz image.")
]
SamDevice = Annotated[str, typer.Option(help="Device for --method sam: cpu or cuda.")]

# Commands on a dataset

Objects = Annotated[
    list[str] | None,
    typer.Option(
        "--object", metavar="NAME", help="Use only this object (id, name or folder, such as 004). Repeatable."
    ),
]
Sight = Annotated[str | None, typer.Option(help="Use only experiments in line of sight (los) or out of it (nlos).")]
Crop = Annotated[
    str | None,
    typer.Option(
        metavar="LOW,HIGH",
        help="Number of lowest and highest slices to drop from measured 77 GHz images. [default: as published, of "
        "each experiment of the published dataset; none of other data]",
        show_default=False,
    ),
]
ExperimentNumber = Annotated[
    int | None, typer.Option("--experiment", min=0, help="Use only experiments with this number.")
]
Workers = Annotated[int | None, typer.Option(min=1, help="Number of processes. [default: one per core, at most eight]")]


def check_sam_device(device: str, methods: Collection[str | None]) -> None:
    """Refuse a device that is not known, or that none of the segmenters uses.

    Raises
    ------
    InputError, UnknownNameError
    """
    check_known("device", device, _SAM_DEVICES)
    if device != "cpu" and "sam" not in methods:
        raise InputError(f"--device {device} is for --method sam, and others run on the CPU; leave --device out")


def checked_window(name: str | None) -> str | None:
    """The window of that name; None for "none". Refused before any work.

    Raises
    ------
    UnknownNameError
    """
    from millisight.imaging import WINDOWS

    if name is not None:
        check_known("window", name, ("none", *WINDOWS))
    return None if name == "none" else name


def checked_sight(sight: str | None) -> str | None:
    """Return `sight` if it is valid or None.

    Raises
    ------
    UnknownNameError
    """
    if sight is not None:
        check_known("--sight", sight, SIGHTS)
    return sight
