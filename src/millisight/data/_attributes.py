"""Metadata as attributes of netCDF and Zarr, which hold texts and numbers alone."""

import json
from typing import Any

import numpy as np

_INTEGERS = np.iinfo(np.int32)  # of netCDF 3


def flat(value: Any) -> str | int | float:
    """A text or a number as it is, anything else as JSON text; `unflat` turns it back.

    A text that is JSON by itself, such as "3", is put into quotes, and so stays a text.

    Examples
    --------
    >>> flat("mug"), flat(2.5), flat([1, None]), flat("3")
    ('mug', 2.5, '[1, null]', '"3"')
    """
    if isinstance(value, str):
        return json.dumps(value) if _is_json(value) else value
    if isinstance(value, float) or (type(value) is int and _INTEGERS.min <= value <= _INTEGERS.max):
        return value
    return json.dumps(value)


def unflat(value: Any) -> Any:
    """What `flat` was given; an array of attributes is a list.

    Examples
    --------
    >>> [unflat(flat(one)) for one in ("mug", 2.5, [1, None], "3", True)]
    ['mug', 2.5, [1, None], '3', True]
    """
    if isinstance(value, str):
        return json.loads(value) if _is_json(value) else value
    return value.tolist() if hasattr(value, "tolist") else value


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True
