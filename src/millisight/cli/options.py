"""Options that several commands have, each written once."""

from pathlib import Path
from typing import Annotated

import typer

from millisight.errors import UnknownNameError
from millisight.io.mito_names import SIGHTS

# Of commands on images or captures

Images = Annotated[
    list[Path],
    typer.Argument(
        metavar="IMAGE",
        help="What `millisight image` or `ms.save` wrote (HDF5), or processed_image*.pkl of the published dataset; "
        "experiments of it, or any folder above them or above HDF5 images.",
    ),
]
RadarChoice = Annotated[str | None, typer.Option(help="Of experiments only this one: 77_ghz or 24_ghz.")]
Multispectral = Annotated[
    bool, typer.Option("--multispectral", help="Of experiments: each 77 GHz image, with the 24 GHz image beside it.")
]
SamDevice = Annotated[str, typer.Option(help="Of sam: cpu or cuda.")]

# Of commands on a dataset

Objects = Annotated[
    list[str] | None,
    typer.Option("--object", metavar="NAME", help="Only this object: id, name or folder, such as 004; repeatable."),
]
Sight = Annotated[str | None, typer.Option(help="Only experiments in line of sight (los), or not (nlos).")]
Crop = Annotated[
    str, typer.Option(metavar="LOW,HIGH", help="Slices of 77 GHz images to leave out, lowest and highest.")
]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes. [default: one a core, eight at most]")]


def checked_sight(sight: str | None) -> str | None:
    """What --sight names, or None.

    Raises
    ------
    UnknownNameError
    """
    if sight is not None and sight not in SIGHTS:
        raise UnknownNameError("--sight", sight, SIGHTS)
    return sight
