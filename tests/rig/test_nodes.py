"""Receivers that stand for others: which do, and that frames hardly differ."""

import dataclasses

import numpy as np
import pytest

import millisight as ms
from millisight.data import LAYERED, AntennaArray, Radar, Trajectory
from millisight.rig.virtual import Part, _nodes, box_sheets, echoes
from millisight.rig.virtual._nodes import Nodes

LINE = Radar.preset("iwr1443").array


def array(rx):
    return AntennaArray(tx_positions=np.zeros((1, 3)), rx_positions=np.array(rx, dtype=float))


def test_the_ends_of_a_short_line_stand_for_its_receivers():
    nodes = Nodes.of(LINE, 0.3)
    assert sorted(nodes.receivers) == [0, len(LINE.rx_positions) - 1]
    places = LINE.rx_positions[nodes.receivers][nodes.between]
    between = places[:, 0] + nodes.shares[:, None] * (places[:, 1] - places[:, 0])
    np.testing.assert_allclose(between, LINE.rx_positions, atol=1e-9)


@pytest.mark.parametrize(
    "rx",
    [
        [[0, 0, 0]],
        [[0, 0, 0], [0, 0.002, 0]],
        [[0, 0, 0], [0.002, 0, 0], [0, 0.002, 0], [0.002, 0.002, 0]],
        [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [0, 0, 0]],
    ],
    ids=["one", "two", "a plane", "too long", "one place"],
)
def test_others_are_computed_by_themselves(rx):
    nodes = Nodes.of(array(rx), 0.3)
    assert list(nodes.receivers) == list(range(len(rx)))
    assert (nodes.between == np.arange(len(rx))[:, None]).all()
    assert not nodes.shares.any()


def test_near_a_surface_no_line_is_short():
    assert len(Nodes.of(LINE, 0.05).receivers) == len(LINE.rx_positions)


@pytest.mark.slow
@pytest.mark.parametrize("cover", [False, True], ids=["in sight", "in a carton"])
def test_frames_are_those_of_receivers_by_themselves(monkeypatch, cover):
    mesh = ms.Scene.from_mesh("mug", vertices=2000).mesh
    lower, upper = mesh.bounds
    sheets = box_sheets(lower - [0.02, 0.02, 0], upper + 0.02, LAYERED["carton"])[1:] if cover else ()
    line = Radar.preset("iwr1443")
    two = np.array([[0, 0, 0], [0.004, 0.01, 0]])
    radar = dataclasses.replace(line, array=AntennaArray(tx_positions=two, rx_positions=LINE.rx_positions))
    path = Trajectory.raster(size=(0.16, 0.16), step=0.04, center=(0.01, 0.02, upper[2] + 0.2))

    def made():
        return echoes([Part(mesh=mesh, material=4 - 0.1j, roughness=5e-5)], radar, path, rng=0, occluders=sheets)

    some = made()
    monkeypatch.setattr(_nodes, "LONGEST", 0.0)
    exact = made()
    level = np.sqrt(np.square(abs(some)).sum(axis=-1) / np.square(abs(exact)).sum(axis=-1))
    assert 0 < abs(20 * np.log10(level)).max() < 0.1
    assert abs(np.angle((some * exact.conj()).sum(axis=-1), deg=True)).max() < 1
    assert np.linalg.norm(some - exact) < 2e-3 * np.linalg.norm(exact)
