"""The virtual rig's optics: seconds a capture against poses, patches and samples, and the floor beside.

    make bench TESTS=benchmarks/test_rig.py

Takes about two minutes on two cores. A *pair* is a patch and a channel (pose x TX x RX) that it faces. The floor is
what the sum over pairs must cost, in vector instructions of float32 (`_kernels`): 109 for a patch and a node, of which
four receivers in a line have two (40 for both distances and angles, 12 for the legs' gradient and the weight, 23 for
the triangle's form, 24 for the reflection, 10 for the amplitude), and 62 a pair (12 for the receiver's distance, 20 for
the phase, 30 for the bins' moments): 117 a pair, 16 lanes and two instructions a clock.
"""

import time

import numba
import numpy as np
import pytest

import millisight as ms
from millisight.data import LAYERED, Trajectory
from millisight.rig.virtual import Antenna, Part, box_sheets, echoes
from millisight.rig.virtual import _patches as patches

INSTRUCTIONS, LANES, A_CLOCK, CLOCK = 117, 16, 2, 2.6e9
FLOOR = INSTRUCTIONS / LANES / A_CLOCK / CLOCK  # seconds a pair and core

RADAR = ms.Radar.preset("iwr1443")
ANTENNA = Antenna(beamwidth_x_deg=56, beamwidth_y_deg=28)


def cuboid(edge):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * edge / 2
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return ms.TriangleMesh(vertices=corners, faces=faces)


def aperture(poses, height, seed=0):
    """A raster of 0.22 x 0.55 m with 0.3 mm of stray."""
    rows = round(np.sqrt(poses / 2.5))
    x, y = np.meshgrid(np.linspace(-0.11, 0.11, rows), np.linspace(-0.275, 0.275, poses // rows), indexing="ij")
    positions = np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], axis=1)
    positions += np.random.default_rng(seed).normal(0, 3e-4, positions.shape)
    return Trajectory(times=np.arange(float(len(positions))), positions=positions)


def facing(mesh, radar, trajectory):
    """How many patches there are, and how many pairs face each other."""
    pieces = patches.cut(mesh.vertices[mesh.faces], patches.REACH * radar.waveform.wavelength)
    normals = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    heights = np.einsum("ni,ni->n", normals, pieces[:, 0])
    some = trajectory.positions[:: max(1, len(trajectory) // 100)]
    share = (some @ normals.T > heights).mean()
    return len(pieces), share * len(pieces) * len(trajectory) * len(radar.array.rx_positions)


def measured(title, mesh, radar, trajectory, **settings):
    part = Part(mesh=mesh, material=4 - 0.1j, roughness=5e-5)
    start, busy = time.perf_counter(), time.process_time()
    frames = echoes([part], radar, trajectory, antenna=ANTENNA, rng=0, **settings)
    wall, busy = time.perf_counter() - start, time.process_time() - busy
    assert abs(frames).max() > 0
    count, pairs = facing(mesh, radar, trajectory)
    floor = pairs * FLOOR
    print(
        f"{title}: {len(trajectory)} poses x {len(radar.array.rx_positions)} RX, {count} patches, "
        f"{radar.waveform.samples_per_chirp} samples: {wall:.1f} s ({busy:.1f} s of one core, floor {floor:.1f} s, "
        f"{busy / pairs * 1e9:.1f} ns a pair)"
    )
    return busy


@pytest.fixture(scope="module", autouse=True)
def compiled():
    for bounces in (1, 2):
        echoes([Part(mesh=cuboid(0.05), material=3.0)], RADAR, aperture(40, 0.3), bounces=bounces, antenna=ANTENNA)
    print(f"\n{numba.get_num_threads()} threads")


def test_against_poses():
    """Four times the poses, at most five times the time."""
    box = cuboid(0.12)
    taken = [measured("poses", box, RADAR, aperture(poses, 0.3)) for poses in (500, 2000, 8000)]
    assert taken[2] < 5 * taken[1]


def test_against_patches():
    """Four times the surface, at most five times the time."""
    taken = [measured("patches", cuboid(edge), RADAR, aperture(2000, 0.35)) for edge in (0.05, 0.1, 0.2)]
    assert taken[2] < 5 * taken[1]


def test_against_samples():
    """Samples cost a product of matrices at the end: eight times as many, less than twice the time."""
    waveform = RADAR.waveform
    taken = []
    for samples in (128, 512, 1024):
        same_band = ms.Waveform.stepped(waveform.start_frequency, waveform.bandwidth / samples, samples)
        radar = ms.Radar(name="samples", waveform=same_band, array=RADAR.array)
        taken.append(measured("samples", cuboid(0.12), radar, aperture(2000, 0.3)))
    assert taken[2] < 2 * taken[0]


@pytest.mark.parametrize("name", ["mug", "cracker_box", "power_drill"])
def test_a_reduced_capture(name):
    """12 000 channels of an object of the catalogue: alone, without double bounces, and under a carton."""
    mesh = ms.Scene.from_mesh(name, vertices=None).mesh
    lower, upper = mesh.bounds
    trajectory = aperture(3000, upper[2] + 0.2)
    carton = box_sheets(lower - [0.02, 0.02, 0], upper + 0.02, LAYERED["carton"])[1:]
    measured(f"{name}, one bounce", mesh, RADAR, trajectory, bounces=1)
    measured(f"{name}, two bounces", mesh, RADAR, trajectory)
    measured(f"{name}, under a carton", mesh, RADAR, trajectory, occluders=carton)
