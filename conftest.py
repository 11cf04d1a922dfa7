"""What holds for every run of pytest here: slow tests take turns, modules that need an extra are skipped without it,
and skips are told.

Where the whole suite is run, a sixth of the tests marked `slow` is, another with every commit: all of them would take
longer than anybody waits for. MILLISIGHT_EVERY=1 runs all, MILLISIGHT_PART=2 the second sixth. Tests that are asked
for by path, name or mark are all run.

MILLISIGHT_NO_SKIP=1 makes every skip a failure. MILLISIGHT_SKIPPED=FILE writes down what was skipped, a line each, so
that `pytest @FILE` runs just that again, where nothing is missing.
"""

import os
import subprocess
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule

_EXTRAS = {"torch": "train"}
"""What modules of the package import at their top, and the extra that brings it."""

_PARTS = 6  # of the slow tests
_PART = pytest.StashKey[int]()


def pytest_configure(config):
    given = getattr(config, "workerinput", {}).get("part")  # to a process of pytest-xdist
    if given is None and _is_whole(config) and not os.environ.get("MILLISIGHT_EVERY"):
        said = os.environ.get("MILLISIGHT_PART") or str(_part_of_commit())
        if said not in map(str, range(1, _PARTS + 1)):
            raise pytest.UsageError(f"MILLISIGHT_PART is {said}; expected 1 to {_PARTS}")
        given = int(said)
    if given is not None:
        config.stash[_PART] = given


def _is_whole(config: pytest.Config) -> bool:
    chosen = config.option.keyword or config.option.markexpr
    return config.args_source is pytest.Config.ArgsSource.TESTPATHS and not chosen


def _part_of_commit() -> int:
    """Another with every commit, the same for all who run it; the first where there is no repository."""
    command = ["git", "rev-parse", "HEAD"]
    try:
        done = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return 1
    return int(done.stdout[:8], 16) % _PARTS + 1


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node):
    node.workerinput["part"] = node.config.stash.get(_PART, None)


def pytest_report_header(config):
    if _PART not in config.stash:
        return None
    return f"slow tests: part {config.stash[_PART]} of {_PARTS} (MILLISIGHT_EVERY=1 runs all)"


def pytest_collection_modifyitems(config, items):
    if _PART not in config.stash:
        return
    kept, others = [], []
    for item in items:
        of_part = zlib.crc32(item.nodeid.encode()) % _PARTS + 1 == config.stash[_PART]
        (kept if of_part or not item.get_closest_marker("slow") else others).append(item)
    config.hook.pytest_deselected(items=others)
    items[:] = kept


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
