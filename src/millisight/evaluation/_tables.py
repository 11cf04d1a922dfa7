"""Tables of results, as Markdown, CSV and HTML."""

import csv
import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from millisight.core import check_known, put, record
from millisight.core.errors import InputError

Cell = str | float | None
PLACES = ("summary", "page", "file")
"""Where a table stands: in a terminal too, on the page, or in a CSV file alone."""


@record
class Table:
    """Rows under named columns.

    Attributes
    ----------
    title : str
    columns : names, with their units
    rows : of as many cells as there are columns: text, numbers, None where there is nothing to say
    notes : texts below it
    place : one of PLACES
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()
    place: str = "page"

    def __post_init__(self) -> None:
        put(self, columns=tuple(self.columns), rows=tuple(map(tuple, self.rows)), notes=tuple(self.notes))
        check_known("place of a table", self.place, PLACES)
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

    def to_dict(self) -> dict[str, Any]:
        """Title, columns, rows and notes, as JSON holds them."""
        return {"title": self.title, "columns": list(self.columns), "rows": [list(row) for row in self.rows],
                "notes": list(self.notes)}  # fmt: skip

    def _repr_html_(self) -> str:
        return self.html()

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


def table_of(
    title: str, columns: str | Sequence[str], rows: Iterable[Sequence[Cell]], *notes: str, place: str = "page"
) -> Table:
    """A table; names of columns in one text are separated by |."""
    names = columns.split("|") if isinstance(columns, str) else columns
    return Table(title=title, columns=tuple(names), rows=tuple(map(tuple, rows)), notes=notes, place=place)


def _shown(cell: Cell) -> str:
    if cell is None:
        return ""
    return f"{cell:.4g}" if isinstance(cell, float) else " ".join(str(cell).split())
