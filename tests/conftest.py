"""Shapes in the annotations are checked while the tests run."""

import os

import pytest
from jaxtyping import install_import_hook

# Before anything of ours is imported: every function with shapes checks its arguments and its result.
install_import_hook(["millisight.imaging.exact", "millisight.imaging.backprojection"], "beartype.beartype")


@pytest.fixture(scope="session")
def miniature(tmp_path_factory):
    """The published dataset in miniature, and its faults, made once: for reading only."""
    from miniature import make

    return make(tmp_path_factory.mktemp("miniature"))


def pytest_terminal_summary(terminalreporter, exitstatus, config):
    """Say why tests were skipped; with MILLISIGHT_NO_SKIP=1, as in CI, a skip for want of a package fails the run."""
    skipped = terminalreporter.stats.get("skipped", [])
    for report in skipped:
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
        terminalreporter.write_line(f"skipped {report.nodeid}: {reason}")


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if exitstatus == 0 and os.environ.get("MILLISIGHT_NO_SKIP") and reporter and reporter.stats.get("skipped"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
