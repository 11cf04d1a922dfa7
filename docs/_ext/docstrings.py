"""The reference from docstrings: a room's public names, and plain docstrings turned into reStructuredText.

The docstrings are written to be read in an editor: `|I|`, `*` and a trailing underscore mean themselves. Sections
("Parameters", "Raises" and their like, underlined) become fields; doctests stay.

    .. public-names:: imaging

documents every name of `millisight` whose home is `millisight.imaging`. What has no docstring is a warning, and so
fails the build: a public name, a method or property of a public class, and a field of a record that its class does not
tell under "Attributes". So is a room that nothing is in.
"""

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from fnmatch import fnmatch
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from numpy.typing import ArrayLike
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles
from sphinx.util.typing import stringify_annotation

import millisight
from millisight.core import errors

_SECTIONS = ("Parameters", "Attributes", "Returns", "Yields", "Raises", "Examples", "Notes")
_PRIMER = re.compile(r"\bprimer (\(\d+\)|\d+)")
_LOG = logging.getLogger(__name__)


def public_names() -> dict[str, Any]:
    """Every public name of `millisight` that has a home, in the order of the alphabet."""
    things = {name: getattr(millisight, name) for name in sorted(millisight.__all__)}
    return {name: thing for name, thing in things.items() if not inspect.ismodule(thing)}


def room_of(thing: Any) -> str:
    """The first folder or module under `millisight` in which something is defined."""
    return thing.__module__.split(".")[1]


def documented(room: str) -> dict[str, Any]:
    """What `.. public-names:: room` shows, by name: of a room of `millisight`, or of a module by its whole name.

    After a module's name may come patterns; then names that match one of them are shown, such as `plot_*`.
    """
    room, *patterns = room.split()
    if "." not in room:
        return {name: thing for name, thing in public_names().items() if room_of(thing) == room}
    module = __import__(room, fromlist=["_"])
    names = getattr(module, "__all__", _own(module))
    shown = [name for name in names if not patterns or any(fnmatch(name, pattern) for pattern in patterns)]
    return {name: getattr(module, name) for name in shown}


def undocumented(name: str, thing: Any) -> list[str]:
    """Of a public name and what belongs to it, what no docstring speaks of: `name`, `name.method`, `name.field`."""
    text = inspect.getdoc(thing) or ""
    # A dataclass without a docstring gets its signature for one.
    missing = [] if text.strip() and not text.startswith(f"{name}(") else [name]
    if not inspect.isclass(thing):
        return missing
    missing += [f"{name}.{field}" for field in _fields(thing) if field not in attributes(text)]
    return missing + [f"{name}.{member}" for member, of in _members(thing) if not (inspect.getdoc(of) or "").strip()]


def _fields(thing: type) -> list[str]:
    """Of a record or a named tuple."""
    return [field.name for field in fields(thing)] if is_dataclass(thing) else list(getattr(thing, "_fields", ()))


def _members(thing: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties of a class, those too that it has from classes of ours."""
    for home in thing.__mro__:
        if not home.__module__.startswith("millisight."):
            continue
        for name, member in vars(home).items():
            of = getattr(member, "fget", None) or getattr(member, "__func__", member)
            if not name.startswith("_") and (inspect.isfunction(of) or isinstance(member, property)):
                yield name, of


def attributes(text: str) -> dict[str, str]:
    """What a class's docstring says of each of its attributes, under that heading."""
    body = dict(_sections(text.split("\n"))).get("Attributes", [])
    entries = [line.partition(" : ") for line in body if not line.startswith(" ")]
    return {name: about for names, _, about in entries for name in names.split(", ") if about.strip()}


class PublicNames(SphinxDirective):
    """`.. public-names:: room`, or a module: what `documented` finds."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        lines = StringList(list(self._directives(self.arguments[0])), source=self.get_source_info()[0])
        if not lines:
            _LOG.warning("no public name lives in %r", self.arguments[0], location=self.get_location())
        found = nodes.section()
        found.document = self.state.document
        nested_parse_with_titles(self.state, lines, found)
        return found.children

    def _directives(self, room: str) -> Iterator[str]:
        home = room.split()[0] if "." in room else "millisight"
        for name, thing in documented(room).items():
            for missing in undocumented(name, thing):
                _LOG.warning("%s of %s has no docstring", missing, room, location=self.get_location())
            kind = "exception" if _is_error(thing) else "class" if inspect.isclass(thing) else "function"
            yield f".. auto{kind}:: {home}.{name}"
            if kind == "class":
                yield "   :members:"
            if kind == "exception":
                yield "   :show-inheritance:"
            yield ""


def _own(module: Any) -> list[str]:
    """The public classes and functions that a module defines."""
    found = {name: thing for name, thing in vars(module).items() if inspect.isclass(thing) or inspect.isfunction(thing)}
    return [name for name, thing in found.items() if thing.__module__ == module.__name__ and not name.startswith("_")]


def _is_error(thing: Any) -> bool:
    return inspect.isclass(thing) and issubclass(thing, Exception)


def to_rst(lines: list[str]) -> list[str]:
    """A docstring's lines as reStructuredText."""
    result: list[str] = []
    for title, body in _sections(lines):
        if title is None or title == "Notes":
            result += [_escaped(line) for line in _with_blocks(body)]
        elif title == "Examples":
            result += ["", ".. rubric:: Example", "", *body, ""]
        else:
            result += ["", f":{title}:", *_entries(title, body), ""]
    return result


def _sections(lines: list[str]) -> Iterator[tuple[str | None, list[str]]]:
    title: str | None = None
    body: list[str] = []
    skip = False
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        if skip:
            skip = False
        elif line in _SECTIONS and following == "-" * len(line):
            yield title, body
            title, body, skip = line, [], True
        else:
            body.append(line)
    yield title, body


def _entries(title: str, body: list[str]) -> Iterator[str]:
    """`name : text` and its deeper lines as the items of a list; what is returned as the text it is."""
    for line in body:
        name, colon, text = line.strip().partition(" : ")
        if not line.strip():
            continue
        if line.startswith(" "):
            yield "      " + _escaped(line.strip())
        elif title == "Raises":
            names = (
                f":py:exc:`~millisight.core.errors.{part}`" if hasattr(errors, part) else f"``{part}``"
                for part in name.split(", ")
            )
            yield from ("", f"    * {', '.join(names)}", "")
        elif colon or title in ("Parameters", "Attributes"):
            yield from (
                "",
                f"    * {', '.join(f'**{_escaped(part)}**' for part in name.split(', '))} – {_escaped(text)}",
            )
        else:
            yield "    " + _escaped(line)


def _with_blocks(body: list[str]) -> Iterator[str]:
    """Indented lines after prose are drawings or code: they keep their shape."""
    inside = False
    for line in body:
        deep = line.startswith("    ")
        if deep and not inside:
            yield from ("", "::", "")
        if inside and line.strip() and not deep:
            yield ""
        inside = deep or (inside and not line.strip())
        yield line


def _escaped(line: str) -> str:
    """`line` with `|`, `*` and `_` meaning themselves; code between backticks is literal, and so are doctests."""
    if line.startswith((">>>", "...", "    ", "::")):
        return line
    parts = re.split(r"(`+[^`]+`+)", line)
    for i, part in enumerate(parts):
        if i % 2:
            code = part.strip("`")
            parts[i] = f"`{code}`" if re.fullmatch(r"[A-Za-z_][\w.]*", code) else f"``{code}``"
        else:
            parts[i] = _PRIMER.sub(_linked, re.sub(r"([|*]|_(?=\W|$))", r"\\\1", part))
    return "".join(parts)


def _linked(cited: re.Match[str]) -> str:
    """ "primer (7)" as a link to the equation; every page that shows docstrings is in `reference`."""
    return f"`{cited[0]} <../explanation/primer.html#equation-{cited[1].strip('()')}>`__"


def _process(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    lines[:] = to_rst(lines)


def _signature(
    app: Any, what: str, name: str, thing: Any, options: Any, arguments: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """A default made by a factory, which Sphinx cannot parse, is an ellipsis; NumPy's ArrayLike is not spelled out."""
    spelled_out = stringify_annotation(ArrayLike, "smart")
    return (arguments or "").replace("<factory>", "...").replace(spelled_out, "ArrayLike") or None, returned


def _skipped(app: Any, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:
    """A named tuple's fields are told in its docstring."""
    return True if (getattr(thing, "__doc__", None) or "").startswith("Alias for field number") else None


def setup(app: Any) -> dict[str, bool]:
    app.add_directive("public-names", PublicNames)
    app.connect("autodoc-process-docstring", _process)
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-skip-member", _skipped)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
