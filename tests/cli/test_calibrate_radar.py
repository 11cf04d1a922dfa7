"""`millisight calibrate`: from a scan of a known target to an image of what it is not told."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import millisight as ms
from millisight.calibration import set_antennas
from millisight.cli.commands import application
from millisight.core.errors import InputError
from millisight.io.mito import experiment_folder, read_experiment
from millisight.rig import PublishedWriter, record_scan
from millisight.rig.virtual import VirtualRig, World, experiment_info

MOUNT = (0.005, -0.004, 0.003)
BALL = """
objects = [{ object = "golf_ball", material = "metal", at = [0.05, 0.04, -0.36] }]
scan = { size = [0.09, 0.08], row_spacing = 0.0078 }
arm = { speed = 0.1, acceleration = 1.0, path_error = 0.0001, encoder_noise = 0.00003 }
radars = [{ preset = "iwr1443", frame_period = 0.05 }]
support = { kind = "styrofoam" }
"""
TARGET = ("--target", "5cm,4cm,-36cm", "--within", "0.5mm", "--sphere", "21.335mm")


@pytest.fixture(scope="module")
def run():
    runner = CliRunner()

    def run(*words):
        result = runner.invoke(application(*words), words)
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return run


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """A metal ball on foam, scanned by the virtual rig with a radar that is not mounted where it is said to be."""
    folder = tmp_path_factory.mktemp("ball")
    (folder / "ball.toml").write_text(BALL)
    world = World.from_toml(folder / "ball.toml")
    rig, experiment = VirtualRig(world), experiment_folder(folder / "data", "058_golf_ball", (0, 0, 0), 1, "los")
    # Without the command `collect`, which has tests of its own: its estimates and pictures are not asked for here.
    writer = PublishedWriter(experiment, info=experiment_info(world), hdf5=False)
    record_scan(rig.arm, rig.radars, None, rig.plan, writer)
    capture = read_experiment(experiment, "77_ghz").to_capture()
    array = capture.radar.array
    told = ms.AntennaArray(tx_positions=array.tx_positions - MOUNT, rx_positions=array.rx_positions - MOUNT)
    ms.save(folder / "scan.h5", set_antennas(capture, told))
    return folder / "scan.h5"


@pytest.mark.slow
def test_the_mount_is_found_by_other_physics_than_the_fits(scan, run, tmp_path):
    path = tmp_path / "ball.calibration.toml"
    result = run("calibrate", "radar", str(scan), *TARGET, "-o", str(path), "--json")
    found = json.loads(result.stdout)
    errors = np.array(found["offset"]) - MOUNT
    assert np.abs(errors / found["offset_uncertainty"]).max() < 3
    assert np.abs(errors).max() < 0.001
    assert abs(found["path_offset"] - 0.15) < max(0.001, 3 * found["path_offset_uncertainty"])
    assert np.abs(found["phases"]).max() < np.radians(15)
    assert "turn about x" in found["undetermined"]
    assert "not determined by this scan" in result.stderr

    grid = "--grid=4cm:6cm:1mm,2.5cm:5cm:1mm,-37cm:-32cm:2mm"
    places = []
    for words in ((), ("--calibration", str(path))):
        image = tmp_path / f"{len(words)}.image.h5"
        said = run("image", str(scan), grid, *words, "-o", str(image)).output
        assert ("calibration: iwr1443: mount, path offset and gains" in said) == bool(words)
        places.append(ms.load(image).peak)
    # The ball's top shines; it is 21 mm over the middle.
    assert np.abs(places[1][:2] - (0.05, 0.04)).max() < 0.003
    assert np.abs(places[0][:2] - (0.05, 0.04)).max() > 0.0035


@pytest.mark.slow
def test_what_is_asked_wrongly_is_told(scan, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words, message in (
        (("--target", "5cm,4cm"), "expected x,y,z"),
        (("--target", "50,40,30"), "without a unit"),
        ((*TARGET, "--corner"), "a sphere or a corner reflector"),
        ((*TARGET, "--search", "900m"), "the band repeats"),
    ):
        with pytest.raises(InputError, match=message):
            run("calibrate", "radar", str(scan), *words)
    run("calibrate", "radar", str(scan), *TARGET, "-o", "a.toml")
    with pytest.raises(InputError, match="expected one for each radar"):
        run("image", str(scan), "--calibration", "a.toml", "--calibration", "a.toml")
