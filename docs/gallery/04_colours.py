"""The paper's rainbow, and a colour map for everybody.

The same image twice, from three sides: above in the rainbow of the paper, below in colours whose brightness shows the
value, also for colour-blind readers and in print.
"""

import millisight as ms
from millisight.viz import plot_image

scene = ms.Scene.from_mesh("adjustable_wrench", vertices=5000)
radar, trajectory = ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0.3, 0.12), step=0.0025)
capture = ms.simulate(scene, radar, trajectory, model="edge")
grid = ms.VoxelGrid.regular((-0.12, -0.05, -0.03), (0.12, 0.05, 0.03), (0.002, 0.002, 0.004))
figure = plot_image(ms.form_image(capture, grid), mesh=scene.mesh, colormap=("jet", "inferno"))
