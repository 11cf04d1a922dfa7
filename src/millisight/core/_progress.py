"""Progress of work in parts."""

from collections.abc import Callable


def share_of(progress: Callable[[int, int], None] | None, number: int, count: int) -> Callable[[int, int], None] | None:
    """What reports the progress of part `number` of `count` as that of the whole."""
    if progress is None or count == 1:
        return progress
    return lambda done, total: progress(number * total + done, count * total)
