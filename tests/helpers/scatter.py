"""Radar scattering once more for tests of the rig's optics: closed forms, and sums in plain NumPy."""

import numpy as np
from scipy.special import jv, spherical_jn, spherical_yn

import millisight as ms
from helpers.oracles import C

METAL = 1 - 1e9j
POINT = ms.AntennaArray.monostatic()
BISTATIC = ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=[[0, 0, 0], [-0.02, 0.01, 0.005]])


def radar(start, step=0.0, count=1, array=POINT, path_offset=0.0):
    waveform = ms.Waveform.stepped(start, step, count)
    return ms.Radar(name="test", waveform=waveform, array=array, path_offset=path_offset)


def from_places(*positions):
    positions = np.reshape(positions, (-1, 3))
    return ms.Trajectory(times=np.arange(float(len(positions))), positions=positions)


def plate(a, b, z=0.0, shift=(0.0, 0.0)):
    """A rectangle that faces up."""
    x, y = np.array([-a, a, a, -a]) / 2 + shift[0], np.array([-b, -b, b, b]) / 2 + shift[1]
    return ms.TriangleMesh(vertices=np.column_stack([x, y, np.full(4, z)]), faces=[[0, 1, 2], [0, 2, 3]])


def mesh_of(solid):
    return ms.TriangleMesh(vertices=solid.vertices, faces=solid.faces)


def plate_sum(a, b, tx, rx, frequencies, *, reflection=-1.0, nodes=110):
    """(N,) Kirchhoff's integral over an upright plate, by Gauss's rule in float64."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    points = np.stack(np.meshgrid(x * a / 2, x * b / 2, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    weights = np.outer(w, w).ravel() * a * b / 4
    r_t, r_r = np.linalg.norm(tx - points, axis=1), np.linalg.norm(rx - points, axis=1)
    weights = weights * (tx[2] / r_t + rx[2] / r_r) / 2 / (r_t * r_r)
    k = 2 * np.pi * frequencies[:, None] / C
    return 1j * reflection * frequencies / C * (weights * np.exp(-1j * k * (r_t + r_r))).sum(axis=1)


def mie_cross_section(radius, frequency):
    """Backscatter of a perfectly conducting sphere (Balanis 2012, Eq. 11-247), summed to convergence."""
    ka = 2 * np.pi * frequency * radius / C
    n = np.arange(1, int(ka + 5 * np.cbrt(ka) + 10))
    j, y = spherical_jn(n, ka), spherical_yn(n, ka)
    dj, dy = spherical_jn(n, ka, derivative=True), spherical_yn(n, ka, derivative=True)
    h, dh = j - 1j * y, dj - 1j * dy
    terms = (-1.0) ** n * (2 * n + 1) * ((j + ka * dj) / (h + ka * dh) - j / h)
    return np.pi * radius**2 / ka**2 * abs(terms.sum()) ** 2


def cross_section(echo, distance):
    """From an echo in the rig's units [1/m]."""
    return 4 * np.pi * abs(echo) ** 2 * distance**4


def decibels(ratio):
    return 10 * np.log10(ratio)


def wedge_diffraction(n, angle, kr=300.0):
    """Half the sum of both polarisations' backscattered diffraction of a wedge of exterior angle n pi, for E along the
    edge and, as the electric field, across it: the exact series less incident and mirrored waves, brought to the form
    D / sqrt(2 pi kr) exp(-i (kr + pi/4)). Balanis 2012, Eq. 13-40.
    """
    m = np.arange(0, int(n * (kr + 8 * np.cbrt(kr) + 20)))
    terms = 1j ** (m / n) * jv(m / n, kr) * 4 / n
    soft = (terms * np.sin(m * angle / n) ** 2).sum()
    hard = (terms * np.where(m == 0, 0.5, 1.0) * np.cos(m * angle / n) ** 2).sum()
    mirrored = sum(
        np.exp(1j * kr * np.cos(turn)) for turn in (2 * angle, 2 * (n * np.pi - angle)) if turn < np.pi
    )  # fmt: skip
    direct = np.exp(1j * kr)
    soft, hard = soft - (direct - mirrored), hard - (direct + mirrored)
    return (soft - hard) / 2 * np.sqrt(2 * np.pi * kr) * np.exp(1j * (kr + np.pi / 4))
