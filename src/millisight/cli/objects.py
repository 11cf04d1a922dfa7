"""`millisight objects`: the catalogue."""

from pathlib import Path
from typing import Annotated

import typer

from millisight.cli.console import answer_json, answer_table, json_only, say
from millisight.cli.outputs import check_outputs
from millisight.core import check_known
from millisight.core.errors import InputError, UnknownNameError


def objects(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="List this object alone.")] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE.ply", help="Write the mesh of the object NAME (PLY, metres)."),
    ] = None,
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

    The class is one of the MITO paper's four, or other: so are cups and clamps, which the classifier knows.

    Example: millisight objects --class can

    Example: millisight objects mug -o mug.ply
    """
    if output is not None and name is None:
        raise InputError(f"-o writes the mesh of one object; name it, as in: millisight objects mug -o {output}")
    if name is not None and shape_class is not None:
        raise InputError(f"{name} is one object, and --class lists those of a class; leave one of them out")
    if output is not None and output.suffix.lower() != ".ply":
        raise InputError(f"--output is {output}; expected a name that ends in .ply, such as {name}.ply")
    check_outputs(output)
    from millisight.meshes import CATALOGUE, build_object, write_mesh

    entries = list(CATALOGUE.values())
    classes = sorted({entry.shape_class for entry in entries})
    if shape_class is not None:
        if shape_class not in classes:
            raise UnknownNameError("--class", shape_class, classes, advice="Cups and clamps are other here.")
        entries = [entry for entry in entries if entry.shape_class == shape_class]
    if name is not None:
        check_known("object", name, CATALOGUE)
        entries = [CATALOGUE[name]]
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
    else:
        sizes = [" x ".join(f"{100 * length:.1f}" for length in entry.dimensions) for entry in entries]
        rows = [
            (entry.name, entry.shape_class, size, ", ".join(made))
            for entry, size, made in zip(entries, sizes, materials, strict=True)
        ]
        answer_table([("name", "class", "size [cm]", "materials"), *rows])
    if output is not None and name is not None:
        write_mesh(output, build_object(name))
        with json_only(as_json):
            say(f"wrote {output}")
