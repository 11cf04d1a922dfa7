"""What made images, told by their files or by the description of weights, as a value that can be compared."""

from typing import Any

from millisight.core import check_known, put, record

RIG, SIMULATOR, UNKNOWN = "virtual rig", "paper's simulator", "unknown"
KINDS = (RIG, SIMULATOR, UNKNOWN)
_KNOWN = {RIG: RIG, **dict.fromkeys((SIMULATOR, "simulator of the paper", "published simulator"), SIMULATOR)}


@record
class Physics:
    """Physics of simulated images.

    Attributes
    ----------
    told : in words: a kind, and after a colon the details; "" where nothing is told
    kind : one of `KINDS`; "unknown" of words that are not known here, and where nothing is told
    """

    told: str = ""
    kind: str = UNKNOWN

    def __post_init__(self) -> None:
        check_known("kind of physics", self.kind, KINDS)
        put(self, told=" ".join(self.told.split()))

    def __str__(self) -> str:
        return self.told or UNKNOWN

    def is_that_of(self, other: "Physics") -> bool | None:
        """Whether both are the same physics; None: this cannot be told."""
        mine, others = _name(self.told), _name(other.told)
        if mine and mine == others:
            return True
        return None if UNKNOWN in (self.kind, other.kind) else self.kind == other.kind


def physics_of(told: Any) -> Physics:
    """The physics that a file states; what is no text, or blank, states nothing."""
    words = told if isinstance(told, str) else ""
    return Physics(told=words, kind=_KNOWN.get(_name(words), UNKNOWN))


def _name(told: str) -> str:
    """What comes before the details."""
    return " ".join(told.partition(":")[0].casefold().split())
