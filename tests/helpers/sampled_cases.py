"""Of many cases that are alike, those that are run: one in so many, or all where MILLISIGHT_EVERY is set."""

import os
from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


def one_in(count: int, cases: Sequence[T]) -> Sequence[T]:
    """Before a release all are run: `MILLISIGHT_EVERY=1 make test`."""
    return cases if os.environ.get("MILLISIGHT_EVERY") else cases[::count]
