"""How well a camera's place on an arm is found from corners of a board, and whether the uncertainty told is true.

    python benchmarks/hand_eye.py --count 80

Cameras, boards and turns are drawn at random; the arm's poses and the corners have errors of known size.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # helpers

from helpers.boards import BOARD, OPTICS, corners_of, setup
from millisight.calibration import hand_eye

PLACE, TURN_DEG, CORNER = 2e-4, 0.05, 0.1  # standard deviations [m], [degrees], [pixels]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=80)
    options = parser.parse_args()
    print(f"arm {1e3 * PLACE:g} mm and {TURN_DEG:g} degrees, corners {CORNER:g} pixels, {options.count} calibrations")
    print("pictures  camera    offset [mm]  tilt [deg]  error / told  beyond 2  beyond 3")
    for pictures in (6, 12, 24):
        for fit in (False, True):
            errors, told = np.moveaxis([one(seed, pictures, fit) for seed in range(options.count)], 1, 0)
            ratio = np.abs(errors) / told
            offset, turn = np.sqrt((errors**2).reshape(-1, 2, 3).mean(axis=(0, 2)))
            beyond = "  ".join(f"{100 * (ratio > limit).mean():6.1f} %" for limit in (2, 3))
            print(
                f"{pictures:8}  {'found too' if fit else 'known':9}  {1e3 * offset:10.2f}  {np.degrees(turn):10.3f}  "
                f"{np.sqrt((ratio**2).mean()):12.2f}  {beyond}"
            )


def one(seed, pictures, fit):
    """Errors (6,) of offset [m] and turn [rad], and their standard deviations as told."""
    rng = np.random.default_rng(seed)
    truth = setup(rng, pictures, place_sigma=PLACE, turn_sigma_deg=TURN_DEG)
    corners = corners_of(truth, rng=rng, sigma=CORNER)
    found = hand_eye(corners, BOARD, truth.positions, truth.orientations, OPTICS, fit_intrinsics=fit)
    turn = Rotation.from_matrix(found.pose[:3, :3] @ truth.camera[:3, :3].T).as_rotvec()
    return np.concatenate([found.offset - truth.camera[:3, 3], turn]), np.sqrt(np.diag(found.covariance))


if __name__ == "__main__":
    main()
