"""Every link in every Markdown page leads to something: files and anchors, on the site and on the forge alike."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md")], key=lambda p: p.parts
)
_CODE = re.compile(r"^(`{3,}|:{3,}).*?^\1|`[^`\n]*`", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(\s*<?([^)\s>]+)>?[^)]*\)")
_REFERENCE = re.compile(r"^\[[^\]]+\]:\s+(\S+)", re.MULTILINE)
_HEADING = re.compile(r"^#{1,6}\s+(.+?)\s*#*$", re.MULTILINE)


def links_of(text):
    prose = _CODE.sub("", text)
    return [found[1] for pattern in (_LINK, _REFERENCE) for found in pattern.finditer(prose)]


def anchor_of(heading):
    """As GitHub makes it."""
    plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower().replace(" ", "-")
    return re.sub(r"[^\w\-]", "", plain)


def anchors_of(text):
    return {anchor_of(heading) for heading in _HEADING.findall(re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))}


def broken(page):
    """What a page links to and is not there."""
    wrong = []
    for link in links_of(page.read_text(encoding="utf-8")):
        path, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", link):
            if not link.startswith(("https://", "http://", "mailto:")):
                wrong.append(link)
            continue
        target = page if not path else (page.parent / path).resolve()
        inside = target.is_relative_to(ROOT)
        there = inside and target.exists()
        if there and anchor:
            there = target.suffix == ".md" and anchor in anchors_of(target.read_text(encoding="utf-8"))
        if not there:
            wrong.append(link)
    return wrong


def test_there_are_pages_and_links():
    assert len(PAGES) > 15
    assert sum(len(links_of(page.read_text(encoding="utf-8"))) for page in PAGES) > 40


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page):
    assert broken(page) == []


def test_broken_links_are_found(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    (tmp_path / "other.md").write_text("# The (first) heading\n", encoding="utf-8")
    page = tmp_path / "page.md"
    page.write_text(
        "[fine](other.md#the-first-heading) [gone](gone.md) [anchor](other.md#second) ![picture](no.png)\n"
        "`[code](x.md)` [out](../secret.md) [mine](#here)\n\n# Here\n\n[reference]: missing.md\n\n"
        "```\n[code](y.md)\n```\n",
        encoding="utf-8",
    )
    assert broken(page) == ["gone.md", "other.md#second", "no.png", "../secret.md", "missing.md"]
