"""A page of pictures that explains itself: one `index.html`, readable without a network or JavaScript."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from html import escape
from pathlib import Path, PurePosixPath
from urllib.parse import quote

from millisight.core import OWN_NAME, PAGE_MARK, check_own, make_folder, put, record, write_text
from millisight.core.errors import FileError, InputError
from millisight.evaluation import ReportFigure, Table
from millisight.viz._style import save_figure

PICTURE_SUFFIXES = (".png", ".svg", ".jpg", ".jpeg", ".webp", ".gif")

_STYLE = """
:root { color-scheme: light; --ink: #1d2328; --soft: #5b6770; --line: #dde2e6; --paper: #ffffff; --ground: #f4f6f7; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 17px/1.6 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
main, header, footer { max-width: 62rem; margin: 0 auto; padding: 0 1.25rem; }
header { padding-top: 2.5rem; }
h1 { font-size: 2rem; line-height: 1.2; margin: 0 0 1rem; }
h2 { font-size: 1.3rem; line-height: 1.3; margin: 0 0 .75rem; }
p { max-width: 46rem; margin: 0 0 1rem; }
nav ol { columns: 18rem; column-gap: 2.5rem; margin: 0 0 1.5rem; padding: 0; }
nav li { margin-left: 1.5rem; break-inside: avoid; }
a { color: #0b5cad; }
section { background: var(--paper); border: 1px solid var(--line); border-radius: 8px; padding: 1.5rem;
  margin: 0 0 1.5rem; }
.wide { overflow-x: auto; }
figure { margin: 0; }
figure img { display: block; max-width: 100%; height: auto; margin: 0 auto 1rem; }
table { border-collapse: collapse; font-size: .92rem; margin-top: .5rem; }
th, td { text-align: left; vertical-align: top; padding: .25rem 1.5rem .25rem 0; border-top: 1px solid var(--line); }
th { font-weight: 500; color: var(--soft); }
footer { color: var(--soft); font-size: .85rem; padding-bottom: 2.5rem; }
@media (max-width: 40rem) {
  section { padding: 1rem; border-radius: 0; margin: 0 -1.25rem 1rem; }
  h1 { font-size: 1.6rem; }
}
@media print {
  body { background: none; }
  section { break-inside: avoid; border: 0; padding: 0; }
  nav { display: none; }
}
"""


@record
class PageItem:
    """One picture of a page, with its description.

    Attributes
    ----------
    heading : str
    picture : name of a picture file in the page's folder; a path relative to that folder, with "/"
    caption : plain text; an empty line begins a new paragraph
    facts : name -> value, shown as a table; may be empty
    alt : what the picture shows, for who cannot see it; default the heading

    Raises
    ------
    InputError
        The picture is no relative path of a picture file, or the heading is empty.
    """

    heading: str
    picture: str
    caption: str
    facts: Mapping[str, object] = field(default_factory=dict)
    alt: str = ""

    def __post_init__(self) -> None:
        if not self.heading.strip():
            raise InputError("a page item without a heading; expected some words")
        path = PurePosixPath(self.picture)
        if (
            path.is_absolute()
            or ".." in path.parts
            or "\\" in self.picture
            or path.suffix.lower() not in PICTURE_SUFFIXES
        ):
            raise InputError(
                f"picture is {self.picture!r}; expected the name of a file in the page's folder "
                f"that ends in {', '.join(PICTURE_SUFFIXES)}"
            )
        put(self, facts=dict(self.facts), alt=self.alt or self.heading)


def write_page(
    folder: str | os.PathLike[str],
    *,
    title: str,
    introduction: str,
    items: Sequence[PageItem],
    tables: Sequence[Table] = (),
) -> Path:
    """Write `index.html` into a folder of pictures: a title, an introduction, tables, and each picture and its caption.

    Parameters
    ----------
    folder : where the pictures are
    title : str
    introduction : plain text; an empty line begins a new paragraph
    items : shown in this order, with a table of contents from three on
    tables : shown before them

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    FileError
        A picture is not in the folder, another page is, or the page cannot be written there.
    """
    folder = Path(folder)
    check_own(folder / "index.html", PAGE_MARK, other="folder")
    for item in items:
        if not (folder / item.picture).is_file():
            raise FileError(f"{folder / item.picture}: no such picture; save it before the page is written")
    contents = "".join(
        f'<li><a href="#picture-{i}">{escape(item.heading)}</a></li>\n' for i, item in enumerate(items, 1)
    )
    sections = "".join(f'<section class="wide">\n{table.html()}</section>\n' for table in tables)
    sections += "".join(_section(i, item) for i, item in enumerate(items, 1))
    page = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<style>{_STYLE}</style>
</head>
<body>
<header>
<h1>{escape(title)}</h1>
{_paragraphs(introduction)}
{f'<nav aria-label="Contents"><ol>{contents}</ol></nav>' if len(items) > 2 else ""}
</header>
<main>
{sections}</main>
{PAGE_MARK}
</body>
</html>
"""
    write_text(folder / "index.html", page)
    (folder / OWN_NAME).unlink(missing_ok=True)  # the page says it
    return folder / "index.html"


def write_report(
    folder: str | os.PathLike[str],
    *,
    title: str,
    introduction: str,
    tables: Sequence[Table],
    figures: Iterable[ReportFigure],
) -> Path:
    """Draw the figures of an evaluation into a folder, and write the page that shows them below its tables.

    Parameters
    ----------
    folder : made where it is missing
    title, introduction, tables : see `write_page`
    figures : drawn one after another

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    FileError
        The folder cannot be written to.
    """
    folder = make_folder(folder)
    items = []
    for one in figures:
        drawn = one.draw()
        for suffix in one.suffixes:
            save_figure(drawn, folder / f"{one.name}{suffix}", dpi=one.dpi)
        picture = f"{one.name}{one.suffixes[0]}"
        items.append(PageItem(heading=one.heading, picture=picture, caption=one.caption, facts=one.facts))
    return write_page(folder, title=title, introduction=introduction, items=items, tables=tables)


def _section(number: int, item: PageItem) -> str:
    source = quote(item.picture)
    rows = "".join(
        f'<tr><th scope="row">{escape(str(name))}</th><td>{escape(str(value))}</td></tr>\n'
        for name, value in item.facts.items()
    )
    return f"""<section id="picture-{number}">
<h2>{escape(item.heading)}</h2>
<figure>
<a href="{source}"><img src="{source}" alt="{escape(item.alt)}"></a>
<figcaption>
{_paragraphs(item.caption)}
</figcaption>
</figure>
{f"<table>{rows}</table>" if rows else ""}
</section>
"""


def _paragraphs(text: str) -> str:
    blocks = (" ".join(block.split()) for block in re.split(r"\n\s*\n", text))
    return "\n".join(f"<p>{escape(block)}</p>" for block in blocks if block)
