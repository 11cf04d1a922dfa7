"""How positions become an image.

One position of a radar measures distances, no directions: its image is rings. Many positions together focus. Computed
by equation (4) of the primer for three point reflectors.
"""

from millisight.viz import plot_aperture_principle

figure = plot_aperture_principle()[0].figure
