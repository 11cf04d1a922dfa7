"""`millisight collect --live` as a person meets it: the image grows in the browser, and a button ends the scan."""

import re
import subprocess
import sys

import pytest

from helpers.browser import chromium, complaints, until
from millisight.io.mito import read_experiment

WORLD = """
[[objects]]
object = "golf_ball"
at = [0.06, 0.09]
[scan]
size = [0.05, 0.12]
corner = [0.035, 0.03]
row_spacing = 0.002
[arm]
speed = 0.5
acceleration = 5
settle = 0.05
[[radars]]
preset = "iwr1443"
frame_period = 0.02
"""


@pytest.fixture(scope="module")
def driver():
    with chromium() as driver:
        yield driver


@pytest.mark.slow
def test_the_image_grows_and_the_button_ends_the_scan(driver, tmp_path):
    (tmp_path / "world.toml").write_text(WORLD)
    command = [
        sys.executable,
        "-m",
        "millisight.cli.main",
        "collect",
        "world.toml",
        "-o",
        "data",
        "--live",
        "--no-browser",
    ]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as scan:
        try:
            lines = iter(scan.stdout.readline, "")
            address = next(m[0] for m in (re.search(r"http://127\S+", line) for line in lines) if m)
            driver.get(address)
            seen = "document.querySelector('#radars section')"
            until(driver, f"{seen} && {seen}.dataset.poses", seconds=60)
            first = int(driver.execute_script(f"return {seen}.dataset.poses"))
            until(driver, f"Number({seen}.dataset.poses) > {first}", seconds=60)
            loaded = "[...document.querySelectorAll('.views img')].every((image) => image.naturalWidth > 10)"
            until(driver, loaded, seconds=10)
            assert driver.execute_script("return document.querySelectorAll('.views img').length") == 3
            driver.find_element("id", "stop").click()
            until(driver, "document.body.dataset.state === 'over'", seconds=60)
            rest = scan.communicate(timeout=60)[0]
        finally:
            scan.kill()
    assert scan.returncode == 0, rest
    assert "ended early, as asked" in rest
    kept = read_experiment(tmp_path / "data/058_golf_ball/robot_collected/0_0_0/exp1/los", "77_ghz")
    assert 0 < len(kept.rows) < 61
    assert complaints(driver) == []
