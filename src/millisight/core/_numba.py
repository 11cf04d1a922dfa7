"""Numba, imported so that no file of the working directory has a say.

Numba reads `.numba_config.yaml` in the folder where a program happens to run: it may name a folder of compiled code,
which is then run. Data from strangers lie in such folders. Settings of the environment, NUMBA_..., count as ever.
"""

import os
import sys
import warnings
from typing import Any

_CONFIG_NAME = ".numba_config.yaml"


def _import_without_file() -> None:
    """Import Numba as if there were no such file; it reads the file anew whenever it compiles."""
    if "numba" not in sys.modules and os.path.exists(_CONFIG_NAME):
        parser = sys.modules.get("yaml")
        sys.modules["yaml"] = None  # ty: ignore[invalid-assignment]  # without a parser, the file is only warned of
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                import numba.core.config
        finally:
            del sys.modules["yaml"]
            if parser is not None:
                sys.modules["yaml"] = parser
    import numba.core.config

    config: Any = numba.core.config
    config._config_fname = ""


_import_without_file()

import numba as numba  # noqa: E402
from numba import prange as prange  # noqa: E402
from numba.core import caching as caching  # noqa: E402
from numba.extending import overload as overload  # noqa: E402
