"""`millisight rig photo` and `millisight calibrate camera`: an emulated arm, and pictures that are drawn."""

import re
import shutil
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from helpers.boards import pictures_of, setup
from helpers.commands import run_here
from millisight.calibration import add_picture, read_poses
from millisight.core import record
from millisight.data import CameraFrame, Intrinsics
from millisight.rig import CameraMount
from millisight.rig.drivers import DRIVERS, Driver
from millisight.rig.emulators import EmulatedLab
from millisight.rig.virtual import ArmSettings, RadarSettings, ScanSettings, World

SQUARE = ("--board", "9x6", "--square", "20mm")
OPTICS = Intrinsics(fx=309.1, fy=308.9, cx=160.4, cy=120.3, width=320, height=240)


@pytest.fixture(scope="module")
def taken():
    """Twelve pictures and their poses, the arm's with errors."""
    rng = np.random.default_rng(0)
    told = setup(rng, 12, place_sigma=2e-4, turn_sigma_deg=0.05)
    return told, list(pictures_of(told, rng, optics=OPTICS))


@pytest.fixture(scope="module")
def written(taken, tmp_path_factory):
    """A folder with the pictures."""
    folder = tmp_path_factory.mktemp("written") / "board"
    told, pictures = taken
    for picture, position, orientation in zip(pictures, told.positions, told.orientations, strict=True):
        add_picture(folder, picture, position, orientation, OPTICS)
    return folder


@pytest.fixture
def board(written, tmp_path, monkeypatch):
    """The folder "board" with the pictures, to change as one likes."""
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(written, tmp_path / "board"))


def lines_of(text):
    """offset, tilt_deg and their standard deviations, as printed."""
    table = tomllib.loads(text[text.index("[camera]") :])["camera"]
    sigmas = [[float(x) for x in found.split(",")] for found in re.findall(r"± \[(.*)\]", text)]
    return np.array(table["offset"]), np.array(table["tilt_deg"]), *map(np.array, sigmas)


def check_truth(text, told):
    """Within 4 standard deviations, of six numbers in four tests; test_hand_eye.py counts how many are beyond 3."""
    mount = CameraMount.of(told.camera)
    offset, tilt, offset_sigma, tilt_sigma = lines_of(text)
    assert (np.abs(offset - mount.offset) < 4 * offset_sigma).all()
    assert (np.abs(tilt - mount.tilt_deg) < 4 * tilt_sigma).all()
    assert offset_sigma.max() < 1e-3
    assert tilt_sigma.max() < 0.1


@pytest.mark.slow
def test_the_camera_s_place_is_found_in_pictures(board, taken):
    code, out, err, error = run_here("calibrate", "camera", "board", *SQUARE, "-o", "camera.toml")
    assert (code, error) == (0, ""), out + err
    assert "pictures used: 12 of 12" in out
    assert float(re.search(r"reprojection error: ([\d.]+) pixels rms", out)[1]) < 2
    corner, place, turn = map(float, re.search(r"corners ([\d.]+) .*arm ([\d.]+) mm and ([\d.]+) deg", out).groups())
    assert corner < 0.1
    assert (place, turn) == pytest.approx((0.2, 0.05), rel=0.4)
    assert "wrote camera.toml; put its lines into the rig file" in out
    assert "warning" not in out
    check_truth((board.parent / "camera.toml").read_text(encoding="utf-8"), taken[0])


@pytest.mark.slow
def test_without_intrinsics_they_are_found_too(board, taken):
    text = (board / "poses.toml").read_text()
    (board / "poses.toml").write_text(re.sub(r"\[intrinsics\][^\[]*", "", text))
    assert read_poses(board).intrinsics is None
    code, out, err, error = run_here("calibrate", "camera", "board", *SQUARE)
    assert (code, error) == (0, ""), out + err
    fx, cy = map(float, re.search(r"found from the pictures: fx ([\d.]+), .* cy ([\d.]+) pixels", out).groups())
    assert (fx, cy) == pytest.approx((OPTICS.fx, OPTICS.cy), abs=1.5)
    check_truth(out, taken[0])


@pytest.mark.slow
def test_pictures_that_cannot_be_used_are_named(board, taken):
    Image.new("RGB", (320, 240)).save(board / "003.png")
    text = (board / "poses.toml").read_text()
    x = repr(read_poses(board).pictures[6].position[0])
    (board / "poses.toml").write_text(text.replace(x, repr(float(x) + 0.02)))
    code, out, _, _ = run_here("calibrate", "camera", "board", *SQUARE)
    assert code == 0
    assert "warning: 003.png: no board of 9x6 inner corners in it; it is not used" in out
    assert re.search(r"warning: 007.png: its corners are off by [\d.]+ pixels; it is not used: check its pose", out)
    assert "pictures used: 10 of 12" in out
    check_truth(out, taken[0])


@pytest.mark.slow
def test_few_turns_are_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    turns = [
        Rotation.from_euler("xyz", angles, degrees=True) for angles in ((-3, -3, 0), (3, -3, 0), (-3, 3, 0), (3, 3, 0))
    ]
    told = setup(rng, turns=turns, place_sigma=1e-3, turn_sigma_deg=0.2)
    for picture, position, orientation in zip(
        pictures_of(told, rng, optics=OPTICS), told.positions, told.orientations, strict=True
    ):
        add_picture("board", picture, position, orientation, OPTICS)
    code, out, _, error = run_here("calibrate", "camera", "board", *SQUARE)
    assert (code, error) == (0, ""), out
    assert "warning: the offset is uncertain; take more pictures" in out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--board", "9", "--square", "20mm"), "--board is '9'; expected its numbers of inner corners such as 9x6"),
        (("--board", "8x6", "--square", "20mm"), "looks the same upside down"),
        (("--board", "9x6", "--square", "20"), "--square is 20 without a unit"),
        (("--board", "7x6", "--square", "20mm"), "0 pictures show the board; expected 3 at least"),
        ((*SQUARE, "-o", "board/poses.toml"), "is the input and would be overwritten"),
    ],
)
def test_what_cannot_be_right_is_refused(board, options, words):
    for picture in sorted(board.glob("*.png"))[2:]:
        picture.unlink()
    poses = (board / "poses.toml").read_text().split("[[pictures]]")
    (board / "poses.toml").write_text("[[pictures]]".join(poses[:3]))
    code, _, _, error = run_here("calibrate", "camera", "board", *options)
    assert code == 1
    assert words in error


def test_a_folder_that_is_not_there_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "bord: no such folder" in run_here("calibrate", "camera", "bord", *SQUARE)[3]


@record
class DrawnSettings:
    """Keys of a camera that shows what it is given."""


class DrawnCamera:
    """A camera that shows what it is given."""

    pictures: tuple = ()
    disturb = staticmethod(lambda: None)

    def __init__(self, settings):
        self.place, self._opened = None, False

    def open(self):
        self._opened = True

    def shoot(self):
        assert self._opened
        position, _ = self.place()
        self.disturb()
        rgb = min(self.pictures, key=lambda one: np.linalg.norm(one[0] - position))[1]
        depth = np.zeros(rgb.shape[:2], np.uint16)
        return CameraFrame(rgb=rgb, depth=depth, pose=np.eye(4), intrinsics=OPTICS)

    def close(self):
        self._opened = False


WORLD = World(
    scan=ScanSettings(size=(0.004, 0.02), row_spacing=0.004),
    arm=ArmSettings(path_error=0.0, encoder_noise=0.0),
    radars=(RadarSettings(frame_period=0.01),),
)


def rig_of(tmp_path, monkeypatch, arm):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(DRIVERS._entries, "drawn", Driver(kind="camera", settings=DrawnSettings, make=DrawnCamera))
    lab = EmulatedLab(WORLD, frames=lambda settings, trajectory: None, arm=arm)
    path = lab.write(tmp_path)
    path.write_text(path.read_text() + '\n[camera]\ndriver = "drawn"\n')
    return lab


@pytest.mark.slow
def test_pictures_are_taken_where_the_arm_is(taken, tmp_path, monkeypatch):
    """The user turns the arm; the pictures and poses that are saved tell where the camera is."""
    told, pictures = taken
    monkeypatch.setattr(DrawnCamera, "pictures", tuple(zip(told.positions, pictures, strict=True)))
    level = Rotation.from_rotvec([np.pi, 0, 0])
    with rig_of(tmp_path, monkeypatch, "ur") as lab:
        controller = lab.robot.controller

        def turn(i):
            place = told.positions[i]
            monkeypatch.setattr(controller.arm, "told", lambda time: place)
            controller._turned = tuple((Rotation.from_quat(told.orientations[i]) * level).as_rotvec())

        for i in range(5):
            turn(i)
            code, out, err, error = run_here("rig", "photo", "rig.toml", "-o", "board")
            assert (code, error) == (0, ""), out + err
            assert re.search(rf"wrote board/00{i + 1}.png, radar frame at [-\d., ]+ m", out)
            assert ("degrees from 00" in out) == (i > 0)
            assert "tells little" not in out
        assert controller.programs == 0  # nothing is moved
        _, out, _, _ = run_here("rig", "photo", "rig.toml", "-o", "board")
        assert "turned by 0.0 degrees from 005.png, the nearest" in out
        assert "warning: a picture of the same turn tells little" in out
        monkeypatch.setattr(DrawnCamera, "disturb", staticmethod(lambda: (turn(0), time.sleep(0.3))))
        code, _, _, error = run_here("rig", "photo", "rig.toml", "-o", "board")
        assert code == 1
        assert re.search(r"the arm moved by [\d.]+ mm and [\d.]+ degrees while the picture was taken", error)
    found = read_poses("board")
    assert [one.file for one in found.pictures] == [f"00{i}.png" for i in range(1, 7)]
    assert np.array([one.position for one in found.pictures[:5]]) == pytest.approx(told.positions[:5])
    assert np.asarray(Image.open("board/002.png")).tolist() == pictures[1].tolist()
    code, out, _, error = run_here("calibrate", "camera", "board", *SQUARE)
    assert (code, error) == (0, "")
    check_truth(out, told)


def test_a_rig_that_cannot_calibrate_its_camera(tmp_path, monkeypatch):
    with rig_of(tmp_path, monkeypatch, "grbl"):
        _, _, _, error = run_here("rig", "photo", "rig.toml")
        assert "a gantry does not turn the camera" in error
    with rig_of(tmp_path, monkeypatch, "ur"):
        rig = tmp_path / "rig.toml"
        rig.write_text(rig.read_text().replace('[camera]\ndriver = "drawn"\n', ""))
        _, _, _, error = run_here("rig", "photo", "rig.toml")
        assert "the rig has no camera; add a [camera] table" in error
    assert not (tmp_path / "board").exists()
