"""What `millisight segment` writes and says: masks, instances and voxels, and what of them is round or flat."""

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.cli.console import in_options, say
from millisight.cli.image_sources import ImageSource
from millisight.data import Instances, Mask, SarImage, VolumeMask
from millisight.perception.segmentation import (
    Flat,
    Round,
    Segmented,
    Segmenter,
    doubts_of,
    find_flat,
    find_round,
    height_of,
    why_no_forms,
)


class Forms(NamedTuple):
    """What of a mask is round or flat.

    Attributes
    ----------
    things : balls and cylinders, then flat tops
    plain : the same as JSON has it, "round" and "flat"
    """

    things: list[Round | Flat]
    plain: dict[str, Any]


def forms_of(mask: Mask, image: SarImage, *, covered: bool) -> Forms:
    """The balls, cylinders and flat tops of a mask on an image."""
    things, tops = (find(mask, image, covered=covered) for find in (find_round, find_flat))
    plain = {"round": [one.plain for one in things], "flat": [one.plain for one in tops]}
    return Forms([*things, *tops], plain)


@dataclass(frozen=True, slots=True)
class Found:
    """One of several objects: where it lies, what it is like, and what speaks against its mask.

    Attributes
    ----------
    forms : Forms
    doubts : sentences
    plain : all of it, as JSON has it
    """

    forms: Forms
    doubts: tuple[str, ...]
    plain: dict[str, Any]

    def __str__(self) -> str:
        (x, y), z, (low, high) = self.plain["centre"], self.plain["height"], (self.plain["lower"], self.plain["upper"])
        length, width = (1e3 * (b - a) for a, b in zip(low, high, strict=True))
        place = f"({x:.3f}, {y:.3f})" if z is None else f"({x:.3f}, {y:.3f}, {z:.3f})"
        return f"{length:.0f} x {width:.0f} mm in x and y, around {place} m"


def objects_of(found: Instances, image: SarImage, *, covered: bool) -> list[Found]:
    """What is told of each of several objects."""
    grid, objects = found.grid_xy, []
    sides = [float(np.ptp(axis)) / max(len(axis) - 1, 1) for axis in (grid.x, grid.y)]
    for mask, score in zip(found, found.scores, strict=True):
        forms, doubts = forms_of(mask, image, covered=covered), doubts_of(mask, image, covered=covered)
        places = [axis[some] for axis, some in zip((grid.x, grid.y), np.nonzero(mask.inside), strict=True)]
        plain = {
            "pixels": int(mask.inside.sum()),
            "score": float(score),
            "centre": [float(one.mean()) for one in places],
            "height": height_of(mask, image, covered=covered),
            "lower": [float(one.min() - side / 2) for one, side in zip(places, sides, strict=True)],
            "upper": [float(one.max() + side / 2) for one, side in zip(places, sides, strict=True)],
            "doubts": [in_options(one) for one in doubts],
            **forms.plain,
        }
        objects.append(Found(forms, doubts, plain))
    return objects


def say_no_forms(image: SarImage, mask: Mask) -> None:
    """Why nothing is told of what is round or flat in a mask, where the image is to blame."""
    # Doubts tell of antennas beside the picture.
    if mask.inside.any() and image.seen_from != "beside" and (reason := why_no_forms(image)):
        say(f"  what is round or flat cannot be told of this image: {reason}")


def entry(
    source: ImageSource, to: Path, kind: str, method: str | None, inside: list[Any], score: float | None
) -> dict[str, Any]:
    """What --json says of an image."""
    sizes = [int(one.sum()) for one in inside]
    return {
        "image": str(source.path), "name": source.name, "output": str(to), "kind": kind, "method": method,
        "found": any(sizes), "sizes": sizes, "score": score,
    }  # fmt: skip


def fingerprint(image: SarImage) -> str:
    """Of the values of an image: tells whether a mask was made of these or of others."""
    return sha256(image.values.tobytes()).hexdigest()


def provenance_of(
    found: Segmented, image: SarImage, source: ImageSource, by: Segmenter, *, seed: int | None, values: str,
    support: float | None,
) -> dict[str, Any]:  # fmt: skip
    """How a mask of an image was made."""
    from millisight.io.mito import origin

    return {
        "image": origin(source.path),
        "fingerprint": fingerprint(image),
        "other_band": None if source.other is None else origin(source.other),
        "method": by.name,
        "score": found.score,
        "condition": source.condition,
        "seed": None if found.prompts is None else seed,
        "values": values,
        **({} if support is None else {"support": support}),
        **({"points": [], "positive": []} if found.prompts is None else found.prompts.plain),
    }


def write_mask(to: Path, found: Segmented, source: ImageSource, by: Segmenter, told: dict[str, Any]) -> None:
    """The mask, and in its file how it was made."""
    from millisight.io import save

    save(to, found.mask, extras={"segmentation": told})
    prompted = "" if found.prompts is None else f" from {len(found.prompts.points)} prompts"
    share = f"{int(found.inside.sum())} pixels, {100 * found.inside.mean():.1f} %"
    if not found.inside.any():
        say(f"{source.name}: nothing found, by {by.name}{prompted}; wrote an empty mask to {to}")
        return
    say(f"{source.name}: mask of {share}, by {by.name}{prompted}; wrote {to}")


def write_instances(
    to: Path, found: Instances, image: SarImage, source: ImageSource, objects: Sequence[Found], *, method: str | None,
    values: str, support: float | None,
) -> None:  # fmt: skip
    """The instances, and in their file how they were made, and what is told of each."""
    from millisight.io import save
    from millisight.io.mito import origin

    provenance = {
        "image": origin(source.path),
        "other_band": None if source.other is None else origin(source.other),
        "method": method,
        "values": values,
        **({} if source.condition == "los" else {"condition": source.condition}),
        **({} if support is None else {"support": support}),
        "objects": [one.plain for one in objects],
    }
    save(to, found, extras={"segmentation": provenance})
    sizes = ", ".join(str(int(mask.inside.sum())) for mask in found)
    count = f"{len(found)} object{'' if len(found) == 1 else 's'}" + (f" of {sizes} pixels" if sizes else "")
    say(f"{source.name}: {count}; wrote {to}")
    for number, one in enumerate(objects, 1):
        for thing in one.forms.things or [one]:
            say(f"  {number}: {thing}")
        for doubt in one.doubts:
            say(f"     {in_options(doubt)}")
    say_no_forms(image, found.mask)
    if not len(found) and source.condition != "nlos":
        say(
            "  if a lid or a cloth covers the scene, say so: --condition nlos; or take its echo off first: "
            "millisight image --clutter lid"
        )


def write_volume(to: Path, found: VolumeMask, source: ImageSource, told: dict[str, Any]) -> None:
    """The voxels, in their file how they were made, and beside it their surface."""
    from millisight.io import save
    from millisight.meshes import write_mesh

    save(to, found, extras={"segmentation": told})
    if not found.inside.any():
        say(f"{source.name}: nothing found, by {told['method']}; wrote an empty mask to {to}, and no surface")
        return
    surface = to.with_suffix(".ply")
    write_mesh(surface, found.surface())
    depths = found.grid.z[found.inside.any(axis=(0, 1))]
    say(
        f"{source.name}: {int(found.inside.sum())} voxels, z {depths[0]:.3f} to {depths[-1]:.3f} m, by "
        f"{told['method']}; wrote {to} and {surface.name}"
    )
