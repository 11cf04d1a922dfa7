"""A mesh, its two simulations, and their sums.

The floor of the mug faces the radar and is bright; its rim and its handle are edges. The material gives the weights of
the two.
"""

import millisight as ms
from millisight.viz import plot_simulation

scene = ms.Scene.from_mesh("mug", vertices=6000)
radar, trajectory = ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0.2, 0.15), step=0.0025)
grid = ms.VoxelGrid.regular((-0.08, -0.06, -0.04), (0.08, 0.06, 0.04), (0.0015, 0.0015, 0.005))
specular, edge = (
    ms.form_image(ms.simulate(scene, radar, trajectory, model=model), grid) for model in ("specular", "edge")
)
figure = plot_simulation(scene.mesh, specular, edge)[0].figure
