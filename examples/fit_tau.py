"""Whether another specular angle tau fits an object's measured image better: simulated anew for each tau.

    python examples/fit_tau.py bench24 plate mug spoon

Takes the meshes and the 77 GHz images in line of sight of a dataset whose objects lie unturned, and prints the best F
over the weights for each tau. Half a minute an object.
"""

import sys
from pathlib import Path

import numpy as np

import millisight as ms
from millisight.evaluation import compare
from millisight.io.mito import read_published
from millisight.meshes import CATALOGUE

TAUS_DEG = (2.5, 5.0, 7.5, 10.0, 15.0, 20.0)


def fit(dataset: Path, name: str) -> None:
    """Print F and weights of one object by tau."""
    folder = dataset / CATALOGUE[name].ycb_id
    measured, _ = read_published(folder / "robot_collected/0_0_0/exp1/los/processed/radars/77_ghz/processed_image.pkl")
    if not isinstance(measured, ms.SarImage):
        sys.exit(f"{name}: its processed_image.pkl holds no image")
    scene = ms.Scene.from_mesh(folder / "nontextured.stl", unit="m").moved((0, 0, -0.2))
    lower, upper = scene.mesh.bounds
    radar = ms.Radar.preset("mito-sim-77ghz")
    path = ms.Trajectory.raster(size=tuple((upper - lower)[:2] + 0.08), step=radar.waveform.wavelength / 2)
    steps = tuple(float(np.diff(axis).mean()) for axis in (measured.grid.x, measured.grid.y, measured.grid.z))
    grid = ms.VoxelGrid.regular(lower - 0.03, upper + 0.03, steps)
    edge = ms.form_image(ms.simulate(scene, radar, path, model="edge"), grid)
    for tau_deg in TAUS_DEG:
        specular = ms.form_image(ms.simulate(scene, radar, path, model="specular", tau_deg=tau_deg), grid)
        best = compare(measured, specular, edge).best
        a1, a2 = best.weights
        print(f"{name:20} tau {tau_deg:4.1f} deg: F {100 * best.score.f:5.1f} %, weights {a1:.2f} and {a2:.2f}")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        print("usage: python examples/fit_tau.py DATASET OBJECT ...", file=sys.stderr)
        sys.exit(2)
    for given in sys.argv[2:]:
        fit(Path(sys.argv[1]), given)
