"""Which devices there are, and a clear error where one asked for is not there."""

import importlib
from importlib.util import find_spec
from typing import Any

from millisight.core.errors import DeviceError, UnknownNameError

DEVICES = ("cpu", "cuda")


def check_device(name: str) -> None:
    """Refuse a device that cannot do the work: never a silent fall back.

    Raises
    ------
    UnknownNameError
        There is no device of this name.
    DeviceError
        "cuda" without numba-cuda, or without a GPU that it can use.

    Examples
    --------
    >>> check_device("cpu")
    >>> check_device("gpu")
    Traceback (most recent call last):
        ...
    millisight.core.errors.UnknownNameError: unknown device 'gpu'. Did you mean 'cpu'? Known: cpu, cuda.
    """
    if not isinstance(name, str) or name not in DEVICES:
        raise UnknownNameError("device", name, DEVICES)
    if name == "cpu":
        return
    if find_spec("numba_cuda") is None:
        raise DeviceError(
            'device="cuda" needs numba-cuda, which is not installed: run pip install "millisight[cuda]", '
            'or use device="cpu"'
        )
    try:
        from millisight.core._numba import numba  # and none of its parts before

        cuda: Any = importlib.import_module(f"{numba.__name__}.cuda")
        available, reason = cuda.is_available(), cuda.cuda_error()
        config: Any = numba.config
        if available and not config.ENABLE_CUDASIM:
            # What it imports only when it compiles. 0.30.4 asks NumPy for what 2.5 no longer has.
            importlib.import_module(f"{numba.__name__}.cuda.np.arrayobj")
    except (ImportError, AttributeError) as error:
        available, reason = False, error
    if not available:
        why = " ".join(str(reason or "CUDA's compiler library NVVM is missing").split())
        raise DeviceError(
            f'device="cuda" found no GPU that it can use ({why}): check that `nvidia-smi` lists one and that '
            'pip install "millisight[cuda]" was run, or use device="cpu"'
        )
