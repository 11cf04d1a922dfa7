"""Shapes that a classifier's training draws at random beside the catalogue's objects: a picture.

python examples/random_shapes.py shapes.png
"""

import sys

from millisight.viz import plot_random_shapes, save_figure

if __name__ == "__main__":
    if len(sys.argv) != 2:
        print("usage: python examples/random_shapes.py PICTURE", file=sys.stderr)
        sys.exit(2)
    save_figure(plot_random_shapes(count=10), sys.argv[1])
