"""Why objects look different to a radar.

What is rough to light is a mirror to waves of 4 mm, so a radar sees a surface only where it faces the radar, and edges.
"""

from millisight.viz import plot_reflection_principle

figure = plot_reflection_principle()[0].figure
