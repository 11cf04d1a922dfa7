"""A recipe made in seconds: a golf ball by the 24 GHz radar, in line of sight and in a carton, and simulated."""

import tomllib

from millisight.datasets.generation import recipe_from_table

TEXT = """
name = "small"
seed = 3

[objects]
names = ["golf_ball"]

[rig]
conditions = ["los", "carton"]
keep = "captures"
margin = 0.01
image = { spacing = [0.008, 0.008, 0.02], margin = 0.01 }

[rig.world]
scan = { size = [0.1, 0.1], corner = [0.12, 0.23], row_spacing = 0.05 }
arm = { speed = 0.2 }
radars = [{ preset = "position2go", mount = [0, 0, 0] }]

[simulator]
radars = ["24_ghz"]
vertices = 300
size = [0.1, 0.2]
margin = 0.01
step = 2.0
image = { spacing = [0.008, 0.008, 0.02], margin = 0.01 }
"""


def table(**changes):
    """The recipe as a table; `changes` take the places of its tables, None takes one out."""
    changed = {**tomllib.loads(TEXT), **changes}
    return {key: value for key, value in changed.items() if value is not None}


def recipe(**changes):
    return recipe_from_table(table(**changes))
