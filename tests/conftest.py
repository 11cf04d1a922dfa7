"""Shapes in the annotations are checked while the tests run."""

import pytest
from jaxtyping import install_import_hook

# Before anything of ours is imported: every function with shapes checks its arguments and its result.
install_import_hook(["millisight.imaging._exact", "millisight.imaging._backprojection"], "beartype.beartype")


@pytest.fixture(scope="session")
def miniature(tmp_path_factory):
    """The published dataset in miniature, and its faults, made once: for reading only."""
    from helpers.miniature import Miniature, make
    from helpers.processes import made_once

    folder = made_once(tmp_path_factory, "miniature", make)
    return Miniature(folder / "MITO_Miniature", folder / "MITO_Faults")
