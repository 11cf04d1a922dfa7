r"""Equations as MathML, which browsers draw by themselves: no script, no font, no TeX.

A `\tag{7}` becomes the number at the right, and the anchor `#equation-7`.
"""

import re
from html import escape
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert

_TAG = re.compile(r"\s*\\tag\{([^}]*)\}")


def as_mathml(tex: str, **options: str) -> str:
    """An equation without its dollars as MathML."""
    # After \bigl the converter leaves these two as they are.
    return convert(tex, **options).replace(r"\lbrace", "{").replace(r"\rbrace", "}")


def _inline(translator: Any, node: Any) -> None:
    translator.body.append(as_mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: Any) -> None:
    text = node.astext()
    tag = _TAG.search(text)
    equation = as_mathml(_TAG.sub("", text).strip(), display="block")
    number = f'<span class="number">({escape(tag[1])})</span>' if tag else ""
    anchor = f' id="equation-{escape(tag[1])}"' if tag else ""
    translator.body.append(f'<div class="equation"{anchor}>{equation}{number}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
