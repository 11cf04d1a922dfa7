"""The annotator's web server, for this machine alone."""

from collections.abc import Callable
from typing import Any

from millisight.viz import PageServer
from millisight.viz.annotator._annotation import Annotation


class AnnotatorServer(PageServer):
    """Serves one annotation until it is closed; to be used in a `with` block.

    Parameters
    ----------
    annotation : Annotation
    port : 0 for any free one

    Raises
    ------
    InputError
        The port cannot be bound.
    """

    def __init__(self, annotation: Annotation, port: int = 0) -> None:
        self.annotation: Annotation = annotation
        super().__init__("millisight.viz.annotator", ("page.html", "page.css", "page.js", "drawing.js"), port)

    def json_at(self, path: str) -> Callable[[], Any] | None:
        return self.annotation.about if path == "about" else None

    def picture_at(self, path: str) -> Callable[[], bytes] | None:
        if not path.startswith("picture/"):
            return None
        return lambda: self.annotation.picture(path.removeprefix("picture/"))

    def posted_to(self, path: str) -> Callable[[Any], Any] | None:
        return {"mask": self.annotation.mask, "save": self.annotation.save}.get(path)

    def finish(self) -> None:
        self.annotation.finish()
