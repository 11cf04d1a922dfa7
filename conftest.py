"""What holds for every run of pytest here: slow tests may take turns, modules that need an extra are skipped without
it, and skips are told.

MILLISIGHT_PART=2 runs the second eighth of the tests marked `slow`, and all others: CI takes another with every commit,
since all of them would take longer than anybody waits for.

MILLISIGHT_NO_SKIP=1 makes every skip a failure. MILLISIGHT_SKIPPED=FILE writes down what was skipped, a line each, so
that `pytest @FILE` runs just that again, where nothing is missing.
"""

import os
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule

_EXTRAS = {"torch": "train"}
"""What modules of the package import at their top, and the extra that brings it."""

_PARTS = 8  # of the slow tests


def pytest_report_header():
    part = _part()
    return f"slow tests: part {part} of {_PARTS} (without MILLISIGHT_PART all are run)" if part else None


def pytest_collection_modifyitems(config, items):
    part, kept, others = _part(), [], []
    for item in items:
        in_turn = not part or zlib.crc32(item.nodeid.encode()) % _PARTS + 1 == part
        (kept if in_turn or not item.get_closest_marker("slow") else others).append(item)
    config.hook.pytest_deselected(items=others)
    items[:] = sorted(kept, key=lambda item: not item.get_closest_marker("first"))


def _part() -> int | None:
    said = os.environ.get("MILLISIGHT_PART")
    if said and said not in map(str, range(1, _PARTS + 1)):
        raise pytest.UsageError(f"MILLISIGHT_PART is {said}; expected 1 to {_PARTS}")
    return int(said) if said else None


def pytest_collectstart(collector):
    """Let the doctests of a module that cannot be imported for want of an extra be skipped, and say why."""
    if isinstance(collector, DoctestModule):
        collector.collect = lambda collect=collector.collect: _skipped_without_extra(collect, collector.nodeid)


def _skipped_without_extra(collect: Callable[[], Iterator], name: str) -> Iterator:
    try:
        yield from collect()
    except pytest.Collector.CollectError as error:
        missing = getattr(error.__cause__, "name", None)
        if not isinstance(error.__cause__, ModuleNotFoundError) or missing not in _EXTRAS:
            raise
        # With the name, since pytest-xdist tells of equal reports once.
        pytest.skip(f"{name} needs {missing}: pip install millisight[{_EXTRAS[missing]}]", allow_module_level=True)


def pytest_terminal_summary(terminalreporter, exitstatus, config):
    """Say why tests were skipped; with MILLISIGHT_NO_SKIP=1, as in CI, a skip for want of a package fails the run."""
    skipped = terminalreporter.stats.get("skipped", [])
    for report in skipped:
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
        terminalreporter.write_line(f"skipped {report.nodeid}: {reason}")


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    skipped = reporter.stats.get("skipped", []) if reporter else []
    if reporter and os.environ.get("MILLISIGHT_SKIPPED"):
        names = dict.fromkeys(report.nodeid for report in skipped)
        Path(os.environ["MILLISIGHT_SKIPPED"]).write_text("".join(f"{name}\n" for name in names), encoding="utf-8")
    if exitstatus == 0 and os.environ.get("MILLISIGHT_NO_SKIP") and skipped:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
