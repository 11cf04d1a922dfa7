"""A browser without a window, for tests of the pages that the library shows: Chromium, driven by Selenium.

Debian has both programs (`apt-get install chromium chromium-driver`); nothing is downloaded here.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = (
    "--headless",
    "--no-sandbox",  # as root in a container there is none
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--window-size=1280,860",
)
WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Flags for pages that draw in three dimensions."""


@contextmanager
def chromium(*flags: str) -> Iterator[Any]:
    """A Selenium driver of a fresh, headless Chromium, or a skip with the reason where there is none.

    It takes about a second to start: one for all tests of a module, by a fixture of that scope.

    Parameters
    ----------
    flags : of Chromium, further ones

    Examples
    --------
    >>> @pytest.fixture(scope="module")
    ... def browser():
    ...     with chromium() as driver:
    ...         yield driver
    """
    webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium: make setup")
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    program = shutil.which("chromedriver")
    if browser is None or program is None:
        pytest.skip("needs a browser: chromium and chromedriver (apt-get install chromium chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in (*_FLAGS, *flags):
        options.add_argument(flag)
    # The driver's path is given, so Selenium looks for none on the network.
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(program))
    try:
        driver.set_page_load_timeout(60)
        driver.set_script_timeout(60)
        yield driver
    finally:
        driver.quit()


def complaints(driver: Any) -> list[str]:
    """What the page's console has held against it since the last call: errors of scripts, files not found."""
    return [entry["message"] for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]


@contextmanager
def served(*words: str, cwd: Any, **environment: str) -> Iterator[tuple[Any, str]]:
    """A command that serves a page, in a process of its own until the end: the process, and the address it prints."""
    process = subprocess.Popen(
        [sys.executable, "-m", "millisight.cli.main", *words], cwd=cwd, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, **environment},
    )  # fmt: skip
    try:
        printed = ""
        while not (found := re.search(r"http://[\w.]+:\d+\S*", printed)):
            line = process.stdout.readline()
            assert line, printed + process.stderr.read()
            printed += line
        yield process, found[0]
    finally:
        process.kill()
        process.communicate()


def until(driver: Any, condition: str, seconds: float = 10) -> None:
    """Wait until an expression of JavaScript is true on the page."""
    end = time.monotonic() + seconds
    while not driver.execute_script(f"return {condition}"):
        assert time.monotonic() < end, condition
        time.sleep(0.01)
