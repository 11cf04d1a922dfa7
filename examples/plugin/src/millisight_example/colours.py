"""A colour map: from black over blue to white, its brightness rising with the value."""

from matplotlib.colors import LinearSegmentedColormap

night = LinearSegmentedColormap.from_list("night", ["#000000", "#14284b", "#2f6db3", "#9fd0f0", "#ffffff"])
