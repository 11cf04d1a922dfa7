"""How positions become an image.

One position of a radar measures distances, but not directions: its image consists of rings. Many positions together
give a focused image. Computed with equation (4) of the primer for three point reflectors.
"""

from millisight.viz import plot_aperture_principle

figure = plot_aperture_principle()[0].figure
