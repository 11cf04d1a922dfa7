"""Why objects look different to a radar.

Surfaces that are rough for light reflect waves of 4 mm like mirrors. So a radar sees a surface only where it faces the
radar, and edges.
"""

from millisight.viz import plot_reflection_principle

figure = plot_reflection_principle()[0].figure
