"""Point clouds with normals, to files and back."""

import warnings

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import FileError, FormatError, InputError
from millisight.io import holds_points
from millisight.meshes import write_mesh

CLOUD = ms.PointCloud(
    points=[[0.1, 0.2, -0.3], [0.0, 1e-9, 5.0]], magnitude=[0.5, 2.0], normals=[[0, 0, 1], [0.6, 0, 0.8]],
    place_sigma=[1e-3, 2e-3], normal_sigma_deg=[1.5, 0.25],
)  # fmt: skip
NAMES = ("points", "magnitude", "normals", "place_sigma", "normal_sigma_deg")


@pytest.mark.parametrize("binary", [True, False])
def test_what_was_written_is_read(tmp_path, binary):
    ms.write_point_cloud(tmp_path / "cloud.ply", CLOUD, binary=binary)
    found = ms.read_point_cloud(tmp_path / "cloud.ply")
    for name in NAMES:
        np.testing.assert_allclose(getattr(found, name), getattr(CLOUD, name), rtol=1e-6)
    assert np.array_equal(found.points, CLOUD.points)
    assert holds_points(tmp_path / "cloud.ply")


def test_a_signalling_nan_is_refused_without_a_warning(tmp_path):
    path = tmp_path / "cloud.ply"
    ms.write_point_cloud(path, CLOUD)
    content = path.read_bytes()
    two = np.float32(2.0).tobytes()  # the magnitude of the second point
    assert content.count(two) == 1
    path.write_bytes(content.replace(two, np.uint32(0x7FA00001).tobytes()))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match="magnitude"):
            ms.read_point_cloud(path)


def test_trimesh_reads_it_as_well(tmp_path):
    import trimesh

    ms.write_point_cloud(tmp_path / "cloud.ply", CLOUD)
    np.testing.assert_allclose(trimesh.load(tmp_path / "cloud.ply").vertices, CLOUD.points)


def test_hdf5_keeps_all_of_it(tmp_path):
    for cloud in (CLOUD, CLOUD.chosen(np.zeros(2, bool))):
        ms.save(tmp_path / "cloud.h5", cloud)
        found = ms.load(tmp_path / "cloud.h5", ms.PointCloud)
        for name in NAMES:
            assert np.array_equal(getattr(found, name), getattr(cloud, name))


def test_pcd_names_the_normals(tmp_path):
    ms.write_point_cloud(tmp_path / "cloud.pcd", CLOUD, binary=False)
    assert "FIELDS x y z intensity normal_x normal_y normal_z place_sigma" in (tmp_path / "cloud.pcd").read_text()


def test_a_mesh_with_sigma_and_colours_is_a_mesh(tmp_path):
    mesh = ms.TriangleMesh(vertices=[[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces=[[0, 1, 2]])
    write_mesh(tmp_path / "mesh.ply", mesh, sigma=np.array([1, 2, 3]) * 1e-3, colours=np.eye(3) * 255)
    assert not holds_points(tmp_path / "mesh.ply")
    corners = ms.read_point_cloud(tmp_path / "mesh.ply")
    np.testing.assert_allclose(corners.place_sigma, [1e-3, 2e-3, 3e-3], rtol=1e-6)
    np.testing.assert_allclose(corners.normals, [[0, 0, 1]] * 3)
    with pytest.raises(InputError, match="sigma has shape"):
        write_mesh(tmp_path / "mesh.ply", mesh, sigma=np.ones(2))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"hello", "is no PLY file"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "vertices without y and z"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
            b"end_header\n1 2 3\n",
            "truncated",
        ),
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nend_header\nabc",
            "truncated",
        ),
        (b"ply\nformat ascii 1.0\nelement face 2\nend_header\n", "vertices first"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n", "lists"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\nthree\n", "no row of numbers"),
    ],
)
def test_what_is_no_cloud_is_refused(tmp_path, content, told):
    (tmp_path / "cloud.ply").write_bytes(content)
    with pytest.raises(FormatError, match=told):
        ms.read_point_cloud(tmp_path / "cloud.ply")


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(FileError):
        ms.read_point_cloud(tmp_path / "none.ply")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"normals": [[0, 0, 2], [0, 0, 1]]}, "expected unit vectors"),
        ({"normals": [[0, 0, 1]]}, "normals has shape"),
        ({"place_sigma": [1e-3, -1e-3]}, "no standard deviation below 0"),
    ],
)
def test_what_is_no_oriented_point_is_refused(given, told):
    with pytest.raises(InputError, match=told):
        ms.PointCloud(points=np.zeros((2, 3)), **given)


@pytest.mark.parametrize("count", ["1e308", "-5", "9" * 4301, "\u0663"])
def test_a_count_that_is_no_number_is_refused(tmp_path, count):
    head = f"ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "a.ply").write_text(f"{head}end_header\n0 0 0\n", encoding="utf-8")
    assert holds_points(tmp_path / "a.ply")
    with pytest.raises(FormatError, match=r"a\.ply states no number of vertices"):
        ms.read_point_cloud(tmp_path / "a.ply")
