"""RECIPE.toml, read into a `Recipe`."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from millisight.core import printable, read_toml, record_from_table
from millisight.core import record_from_file as record_from_file
from millisight.datasets.generation._recipe import Recipe


def read_recipe(path: str | os.PathLike[str]) -> Recipe:
    """The recipe that a TOML file holds; relative paths in it start at its own folder.

    Raises
    ------
    FormatError
        The file is no TOML, or holds a key or a value that cannot be right; the message names the place.
    FileError
        It cannot be read.
    """
    table = read_toml(path, "a recipe")
    return recipe_from_table(table, folder=str(Path(path).parent), source=printable(path))


def recipe_from_table(table: Mapping[str, Any], *, folder: str = ".", source: str = "recipe") -> Recipe:
    """The recipe that a table describes, as RECIPE.toml does.

    Parameters
    ----------
    table : keys as in RECIPE.toml
    folder : where relative paths start
    source : name of the table for messages

    Raises
    ------
    FormatError
        A key or a value cannot be right; the message names the place.
    """
    return record_from_table(Recipe, table, source, folder=folder, source=source)
