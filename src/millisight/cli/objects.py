"""`millisight objects`: the catalogue."""

from typing import Annotated

import typer

from millisight.cli.console import answer_json, answer_table
from millisight.core import check_known


def objects(
    shape_class: Annotated[
        str | None, typer.Option("--class", metavar="NAME", help="List only objects of this class, such as can.")
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json",
            help='Print one JSON document: {"objects": [{"name", "ycb_id", "class", "category", "materials", '
            '"size_m"}]}.',
        ),
    ] = False,
) -> None:
    """List the objects of the catalogue: class, size and materials. `simulate` and worlds know them by name.

    Example: millisight objects --class can
    """
    from millisight.meshes import CATALOGUE

    entries = list(CATALOGUE.values())
    classes = sorted({entry.shape_class for entry in entries})
    if shape_class is not None:
        check_known("--class", shape_class, classes)
        entries = [entry for entry in entries if entry.shape_class == shape_class]
    materials = [list(dict.fromkeys(material for _, material in entry.parts)) for entry in entries]
    if as_json:
        told = [
            {
                "name": entry.name,
                "ycb_id": entry.ycb_id,
                "class": entry.shape_class,
                "category": entry.category,
                "materials": made,
                "size_m": list(entry.dimensions),
            }
            for entry, made in zip(entries, materials, strict=True)
        ]
        answer_json({"objects": told})
        return
    rows = [("name", "class", "size [cm]", "materials")]
    for entry, made in zip(entries, materials, strict=True):
        size = " x ".join(f"{100 * length:.1f}" for length in entry.dimensions)
        rows.append((entry.name, entry.shape_class, size, ", ".join(made)))
    answer_table(rows)
