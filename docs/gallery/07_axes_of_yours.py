"""Draw into your own figure.

Each of the paper's figures accepts and returns Matplotlib axes. Here a simulation is plotted beside the positions of
the radar.
"""

from matplotlib.figure import Figure

import millisight as ms
from millisight.viz import draw_outline, plot_multispectral

scene = ms.Scene.from_mesh("padlock", vertices=4000)
radar, trajectory = ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory.raster(size=(0.3, 0.3), step=0.006)
grid = ms.VoxelGrid.regular((-0.06, -0.06, -0.02), (0.06, 0.06, 0.02), (0.002, 0.002, 0.01))
image = ms.form_image(ms.simulate(scene, radar, trajectory, model="edge"), grid)

figure = Figure(figsize=(8, 3.2), layout="constrained")
left, middle, right = figure.subplots(1, 3)
plot_multispectral({"24 GHz": image}, {}, axes=[left])
plot_multispectral({"24 GHz": image}, {}, colormap="jet", axes=[middle])
left.set_title("24 GHz, edges")
middle.set_title("the same in jet")
right.plot(*trajectory.positions[:, :2].T, ".", markersize=1, color="0.6")
draw_outline(right, scene.mesh, "z", color="black")
right.set(aspect="equal", title="positions above the padlock", xlabel="x [m]", ylabel="y [m]")
