"""Tables of results, as Markdown, CSV and HTML; and how sure a statistic of a few values is."""

import csv
import io
from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np

from millisight.errors import InputError
from millisight.records import put, record

Cell = str | float | None


@record
class Table:
    """Rows under named columns.

    Attributes
    ----------
    title : str
    columns : names, with their units
    rows : of as many cells as there are columns: text, numbers, None where there is nothing to say
    notes : said below it
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        put(self, columns=tuple(self.columns), rows=tuple(map(tuple, self.rows)), notes=tuple(self.notes))
        for number, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise InputError(
                    f"row {number} of {self.title!r} has {len(row)} cells; expected {len(self.columns)}, one a column"
                )

    def markdown(self) -> str:
        """A heading, a table whose source is aligned, and the notes."""
        lines = [[_shown(cell).replace("|", "\\|") for cell in row] for row in (self.columns, *self.rows)]
        widths = [max(3, *(len(line[i]) for line in lines)) for i in range(len(self.columns))]
        head, *body = (
            "| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in lines
        )
        marks = [
            "-" * (width - 1) + ":" if numeric else "-" * width
            for width, numeric in zip(widths, self._numeric(), strict=True)
        ]
        rule = "| " + " | ".join(marks) + " |"
        return "\n\n".join([f"### {self.title}", "\n".join([head, rule, *body]), *self.notes])

    def csv(self) -> str:
        """The columns' names and the rows, numbers in full; no title and no notes."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([["" if cell is None else cell for cell in row] for row in self.rows])
        return text.getvalue()

    def html(self) -> str:
        """A heading, a `<table>` and the notes, escaped."""
        sides = [' style="text-align: right"' if numeric else "" for numeric in self._numeric()]

        def line(cells: tuple[Cell, ...], tag: str) -> str:
            row = (f"<{tag}{side}>{escape(_shown(cell))}</{tag}>" for cell, side in zip(cells, sides, strict=True))
            return f"<tr>{''.join(row)}</tr>\n"

        body = "".join(line(row, "td") for row in self.rows)
        notes = "".join(f"<p>{escape(note)}</p>\n" for note in self.notes)
        return (
            f"<h2>{escape(self.title)}</h2>\n<table>\n<thead>{line(self.columns, 'th')}</thead>\n"
            f"<tbody>\n{body}</tbody>\n</table>\n{notes}"
        )

    def _numeric(self) -> list[bool]:
        """Which columns hold numbers, or nothing, in all of their rows."""
        return [
            bool(self.rows) and all(not isinstance(row[i], str) for row in self.rows) for i in range(len(self.columns))
        ]


def bootstrap_interval(
    values: Any,
    statistic: Callable[[np.ndarray], float] = np.median,
    *,
    level: float = 0.95,
    draws: int = 2000,
    rng: int | np.random.Generator = 0,
) -> tuple[float, float]:
    """The percentile bootstrap interval of a statistic (Efron 1979).

    Parameters
    ----------
    values : (n,) or (n, k); drawn n times with replacement along the first axis, so that rows stay together
    statistic : of an array of that shape, one number
    level : share of the draws inside
    draws : how many
    rng : seed, or generator

    Raises
    ------
    InputError
        No values, or a level not between 0 and 1.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim < 1 or not len(array):
        raise InputError(f"bootstrap_interval got values of shape {array.shape}; expected at least one")
    if not 0 < level < 1:
        raise InputError(f"level = {level:g}; expected a share between 0 and 1")
    picks = np.random.default_rng(rng).integers(0, len(array), size=(draws, len(array)))
    found = [float(statistic(array[pick])) for pick in picks]
    low, high = np.quantile(found, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def _shown(cell: Cell) -> str:
    if cell is None:
        return ""
    return f"{cell:.4g}" if isinstance(cell, float) else " ".join(str(cell).split())
