"""Range profiles: the raw data of an image.

Range profiles along a scan of 60 cm: the object comes closer and moves away again. Imaging corrects this curve.
"""

import millisight as ms
from millisight.viz import plot_range_profiles

scene = ms.Scene.from_mesh("rubiks_cube", vertices=2000)
trajectory = ms.Trajectory.raster(size=(0.6, 0.0), step=0.002)
capture = ms.simulate(scene, ms.Radar.preset("mito-sim-77ghz"), trajectory, model="edge", snr_db=10, rng=0)
figure = plot_range_profiles(capture, dynamic_range_db=40)
