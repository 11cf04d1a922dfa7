"""Shapes that a classifier's training draws at random beside the catalogue's objects: a picture.

python examples/random_shapes.py shapes.png
python examples/random_shapes.py things.png --household
"""

import argparse

from millisight.viz import plot_random_shapes, save_figure

if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="python examples/random_shapes.py", description="A picture of shapes drawn at random."
    )
    parser.add_argument("picture", help="file, such as shapes.png")
    parser.add_argument("--household", action="store_true", help="household things rather than plain shapes")
    options = parser.parse_args()
    save_figure(plot_random_shapes(count=10, household=options.household), options.picture)
