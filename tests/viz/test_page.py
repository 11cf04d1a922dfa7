"""The page of pictures: what a browser would see, read with the standard library's parser."""

from html.parser import HTMLParser

import pytest

from millisight.core.errors import FileError, InputError
from millisight.viz import PageItem, write_page

VOID = {"meta", "img", "br", "link", "hr"}


class Reader(HTMLParser):
    """Tags with their attributes, the text by tag, and a check that all tags are closed in order."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.tags, self.texts = [], [], {}
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and data.strip():
            self.texts.setdefault(self.open[-1], []).append(data)


@pytest.fixture
def folder(tmp_path):
    for name in ("mug.png", "wrench & co.png", "box.svg"):
        (tmp_path / name).write_bytes(b"picture")
    return tmp_path


def items():
    return [
        PageItem(
            heading="A mug", picture="mug.png", caption="Its rim.\n\nIts handle.", facts={"peak": "2 mm", "poses": 9}
        ),
        PageItem(heading="Wrench <77 GHz>", picture="wrench & co.png", caption='a < b & "c"', alt='the "wrench"'),
        PageItem(heading="A box", picture="box.svg", caption="Flat."),
    ]


def written(folder, **changes):
    texts = {"title": "Seeing <through> boxes", "introduction": "One.\n \nTwo & three.", "items": items()}
    path = write_page(folder, **{**texts, **changes})
    assert path == folder / "index.html"
    return path.read_text(encoding="utf-8")


def test_every_picture_is_there_with_a_text_for_who_cannot_see_it(folder):
    pictures = [attributes for tag, attributes in Reader(written(folder)).tags if tag == "img"]
    assert [p["src"] for p in pictures] == ["mug.png", "wrench%20%26%20co.png", "box.svg"]
    assert [p["alt"] for p in pictures] == ["A mug", 'the "wrench"', "A box"]


def test_text_is_escaped_and_arrives_whole(folder):
    text = written(folder)
    reader = Reader(text)
    assert "<through>" not in text
    assert "<77 GHz>" not in text
    assert reader.texts["h1"] == ["Seeing <through> boxes"]
    assert reader.texts["title"] == ["Seeing <through> boxes"]
    assert reader.texts["h2"] == ["A mug", "Wrench <77 GHz>", "A box"]
    assert reader.texts["p"][:5] == ["One.", "Two & three.", "Its rim.", "Its handle.", 'a < b & "c"']


def test_facts_are_a_table(folder):
    reader = Reader(written(folder))
    assert (reader.texts["th"], reader.texts["td"]) == (["peak", "poses"], ["2 mm", "9"])
    assert sum(tag == "table" for tag, _ in reader.tags) == 1


def test_contents_lead_to_the_pictures(folder):
    reader = Reader(written(folder))
    targets = [a["href"] for tag, a in reader.tags if tag == "a" and a["href"].startswith("#")]
    assert targets == [f"#{a['id']}" for tag, a in reader.tags if tag == "section"]
    assert len(targets) == 3
    assert "nav" not in dict(Reader(written(folder, items=items()[:2])).tags)


def test_the_page_needs_nothing_else(folder):
    text = written(folder)
    assert "http" not in text
    assert "<script" not in text
    assert str(folder) not in text
    assert text == written(folder)
    assert sorted(p.name for p in folder.iterdir()) == ["box.svg", "index.html", "mug.png", "wrench & co.png"]


def test_a_missing_picture_is_refused_and_nothing_written(folder):
    (folder / "mug.png").unlink()
    with pytest.raises(FileError, match=r"mug\.png"):
        written(folder)
    assert not (folder / "index.html").exists()


@pytest.mark.parametrize("picture", ["/etc/mug.png", "../mug.png", "mug.html", "", "a\\mug.png"])
def test_only_pictures_of_the_folder(picture):
    with pytest.raises(InputError, match="picture"):
        PageItem(heading="A mug", picture=picture, caption="")


def test_a_heading_is_needed():
    with pytest.raises(InputError, match="heading"):
        PageItem(heading=" ", picture="mug.png", caption="")


def test_a_page_that_is_not_ours_is_kept(tmp_path):
    (tmp_path / "index.html").write_text("<h1>mine</h1>")
    with pytest.raises(FileError, match=r"index.html was not made by millisight and would be overwritten; choose"):
        write_page(tmp_path, title="A", introduction="B", items=[])
    assert (tmp_path / "index.html").read_text() == "<h1>mine</h1>"
    (tmp_path / "ours").mkdir()
    write_page(tmp_path / "ours", title="A", introduction="B", items=[])
    assert "<h1>C</h1>" in write_page(tmp_path / "ours", title="C", introduction="B", items=[]).read_text()
