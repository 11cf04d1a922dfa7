"""Evaluations without their figures, where a test looks at tables, results and caches only."""

from contextlib import contextmanager

import pytest


@contextmanager
def undrawn():
    """Within the block evaluations write no page and draw no figure, which takes most of a small one's time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("millisight.viz.write_report", lambda folder, **_: folder / "index.html")
        yield
