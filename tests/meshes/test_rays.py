"""Rays and triangles."""

import subprocess
import sys

import numpy as np
import pytest

from millisight.core.errors import MeshError
from millisight.meshes import RayCaster

SHORT_OF_MEMORY = """
import resource
import numpy as np
from millisight.meshes import RayCaster
triangles = np.random.default_rng(0).normal(size=(100, 3, 3))
RayCaster(triangles)  # so that all is imported
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
for spare in range(20_000_000, 260_000_001, 20_000_000):
    resource.setrlimit(resource.RLIMIT_AS, (used + spare, resource.RLIM_INFINITY))
    try:
        RayCaster(triangles).first(np.zeros((10, 3)), np.ones((10, 3)))
    except MemoryError as error:
        print(error)
"""


def test_what_is_between_two_places():
    wall = np.array([[[-1, -1, 1], [3, -1, 1], [-1, 3, 1]]], dtype=float)
    caster = RayCaster(wall)
    starts = np.array([[0, 0, 0], [0, 0, 1.5], [2.5, 2.5, 0]], dtype=float)
    np.testing.assert_array_equal(caster.blocked(starts, np.array([0, 0, 2.0])), [True, False, False])
    face, reach = caster.first(starts, np.array([[0, 0, 2], [0, 0, 1], [0, 0, 1]], dtype=float))
    np.testing.assert_array_equal(face, [0, -1, -1])
    assert reach[0] == pytest.approx(0.5)


def test_what_no_unit_makes_so_small_is_refused():
    """Rays of single precision would meet all of its faces, one by one."""
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=float)
    RayCaster(1e-5 * corners)
    with pytest.raises(MeshError, match=r"1.4e-09 m long; expected 1e-06 m at least: check its unit"):
        RayCaster(1e-9 * corners)


@pytest.mark.skipif(sys.platform != "linux", reason="limits of addresses are Linux's")
def test_too_little_memory_is_an_error_and_not_the_process_s_end():
    done = subprocess.run([sys.executable, "-c", SHORT_OF_MEMORY], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["the search for what rays meet needs 280 MB"] * 13
