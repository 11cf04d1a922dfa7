"""Why objects look different to a radar.

What is rough to light is a mirror to waves of 4 mm, so a radar sees a surface only where it faces the radar, and edges.
"""

from millisight.viz import plots

figure = plots.plot_reflection_principle()[0].figure
