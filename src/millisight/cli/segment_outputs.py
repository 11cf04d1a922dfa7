"""What `millisight segment` writes and says: masks, instances and voxels, and what of them is round or flat."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from millisight.cli.console import say
from millisight.cli.image_sources import ImageSource
from millisight.data import Instances, Mask, SarImage, VolumeMask
from millisight.perception.segmentation import Flat, Round, Segmented, Segmenter, find_flat, find_round


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


def entry(
    source: ImageSource, to: Path, kind: str, method: str | None, inside: list[Any], score: float | None
) -> dict[str, Any]:
    """What --json says of an image."""
    sizes = [int(one.sum()) for one in inside]
    return {
        "image": str(source.path), "name": source.name, "output": str(to), "kind": kind, "method": method,
        "found": any(sizes), "sizes": sizes, "score": score,
    }  # fmt: skip


def provenance_of(
    found: Segmented, source: ImageSource, by: Segmenter, *, seed: int | None, values: str, support: float | None
) -> dict[str, Any]:
    """How a mask was made."""
    from millisight.io.mito import origin

    return {
        "image": origin(source.path),
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
    to: Path, found: Instances, source: ImageSource, forms: Sequence[Forms], *, method: str | None, values: str,
    support: float | None,
) -> None:  # fmt: skip
    """The instances, and in their file how they were made, and what of each is round or flat."""
    from millisight.io import save
    from millisight.io.mito import origin

    provenance = {
        "image": origin(source.path),
        "other_band": None if source.other is None else origin(source.other),
        "method": method,
        "values": values,
        **({} if source.condition == "los" else {"condition": source.condition}),
        **({} if support is None else {"support": support}),
        **({"objects": [one.plain for one in forms]} if any(one.things for one in forms) else {}),
    }
    save(to, found, extras={"segmentation": provenance})
    sizes = ", ".join(str(int(mask.inside.sum())) for mask in found)
    count = f"{len(found)} object{'' if len(found) == 1 else 's'}" + (f" of {sizes} pixels" if sizes else "")
    say(f"{source.name}: {count}; wrote {to}")
    for number, one in enumerate(forms, 1):
        for thing in one.things:
            say(f"  {number}: {thing}")
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
