"""Slices in decibels.

Three point reflectors at two heights, in three planes through the brightest voxel. Along z the image is wider than
across: see (5) and (6) in the primer.
"""

import numpy as np

import millisight as ms
from millisight.viz import plot_slices

vertices = np.array([[-0.03, 0.0, 0.0], [0.03, 0.01, 0.02], [0.03, 0.02, 0.02]])
mesh = ms.TriangleMesh(vertices=vertices, faces=np.array([[0, 1, 2]]))
scene = ms.Scene.from_mesh(mesh, vertices=None, center=False)
trajectory = ms.Trajectory.raster(size=(0.2, 0.2), step=0.0025, center=(0, 0, 0.25))
capture = ms.simulate(scene, ms.Radar.preset("mito-sim-77ghz"), trajectory, model="diffuse")
grid = ms.VoxelGrid.regular((-0.06, -0.05, -0.03), (0.06, 0.05, 0.05), (0.001, 0.001, 0.002))
figure = plot_slices(ms.form_image(capture, grid))
