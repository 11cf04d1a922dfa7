"""Points of images, and their files read back by another library."""

import numpy as np
import pytest
import trimesh

from millisight.core.errors import InputError, UnknownNameError
from millisight.data import PointCloud, SarImage, VoxelGrid
from millisight.evaluation import point_cloud
from millisight.io import write_point_cloud

GRID = VoxelGrid(x=np.array([0.1, 0.2, 0.4]), y=np.array([0.0, 0.5]), z=np.array([-0.3, -0.1]))


def image(**at):
    values = np.zeros(GRID.shape, dtype=np.complex64)
    values[0, 0, 0], values[1, 1, 0], values[2, 0, 1] = 4j, -2, 1
    return SarImage(grid=GRID, values=values)


def test_points_are_the_centres_of_voxels_above_a_share_of_the_maximum():
    cloud = point_cloud(image(), 0.3)
    np.testing.assert_allclose(cloud.points, [[0.1, 0.0, -0.3], [0.2, 0.5, -0.3]])
    np.testing.assert_allclose(cloud.magnitude, [4, 2])


def test_the_threshold_itself_is_not_above_it():
    assert [len(point_cloud(image(), share)) for share in (0.0, 0.25, 0.5, 0.99)] == [3, 2, 1, 1]


def test_absolute_thresholds_are_in_the_images_unit():
    assert [len(point_cloud(image(), level, relative=False)) for level in (0.5, 1.5, 3, 5)] == [3, 2, 1, 0]


def test_flat_clouds_are_of_the_mean_along_z():
    cloud = point_cloud(image(), 0.4, flat=True)
    np.testing.assert_allclose(cloud.points, [[0.1, 0.0, 0.0], [0.2, 0.5, 0.0]])
    np.testing.assert_allclose(cloud.magnitude, [2, 1])


def test_an_image_of_nothing_has_no_points():
    assert len(point_cloud(SarImage(grid=GRID, values=np.zeros(GRID.shape, dtype=np.complex64)))) == 0


@pytest.mark.parametrize(("threshold", "relative"), [(1.0, True), (-0.1, True), (-1.0, False), (np.nan, True)])
def test_thresholds_that_cannot_be_right_are_refused(threshold, relative):
    with pytest.raises(InputError, match="threshold"):
        point_cloud(image(), threshold, relative=relative)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("count", [0, 1, 57])
def test_ply_is_read_back_by_trimesh(tmp_path, binary, count):
    rng = np.random.default_rng(count)
    cloud = PointCloud(points=rng.normal(size=(count, 3)), magnitude=rng.random(count))
    write_point_cloud(tmp_path / "cloud.ply", cloud, binary=binary)
    if count:
        read = trimesh.load(tmp_path / "cloud.ply")
        np.testing.assert_array_equal(read.vertices, cloud.points)
    assert f"element vertex {count}\n".encode() in (tmp_path / "cloud.ply").read_bytes()


@pytest.mark.parametrize("binary", [True, False])
def test_pcd_holds_what_its_header_says(tmp_path, binary):
    rng = np.random.default_rng(1)
    cloud = PointCloud(points=rng.normal(size=(9, 3)), magnitude=rng.random(9))
    write_point_cloud(tmp_path / "cloud.pcd", cloud, binary=binary)
    header, _, body = (tmp_path / "cloud.pcd").read_bytes().partition(b"DATA binary\n" if binary else b"DATA ascii\n")
    fields = dict(line.split(" ", 1) for line in header.decode().splitlines() if not line.startswith("#"))
    assert fields["POINTS"] == fields["WIDTH"] == "9"
    assert fields["FIELDS"].split() == ["x", "y", "z", "intensity"]
    if binary:
        kinds = [f"<f{size}" for size in fields["SIZE"].split()]
        rows = np.frombuffer(body, dtype=list(zip(fields["FIELDS"].split(), kinds, strict=True)))
        points, values = np.stack([rows[name] for name in "xyz"], axis=-1), rows["intensity"]
    else:
        table = np.loadtxt(body.decode().splitlines())
        points, values = table[:, :3], table[:, 3].astype(np.float32)
    np.testing.assert_array_equal(points, cloud.points)
    np.testing.assert_array_equal(values, cloud.magnitude)


def test_other_suffixes_are_refused(tmp_path):
    with pytest.raises(UnknownNameError, match=r"point cloud format '.xyz'"):
        write_point_cloud(tmp_path / "cloud.xyz", PointCloud(points=np.zeros((1, 3))))
    assert not list(tmp_path.iterdir())
