"""Shapes in the annotations are checked while the tests run."""

import sys
from pathlib import Path

from jaxtyping import install_import_hook

# Before anything of ours is imported: every function with shapes checks its arguments and its result.
install_import_hook(["millisight.imaging.exact", "millisight.imaging.backprojection"], "beartype.beartype")

sys.path.insert(0, str(Path(__file__).parent))  # so that tests import `oracles`
