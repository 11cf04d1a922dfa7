"""Household things by class, of 131 kinds, their proportions drawn at random.

A kind takes a random generator and returns a solid in millimetres, as it lies or stands on a table, z up. Each is
drawn by eye, after common ware; none after any one object, and sizes are those of a household.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._household.balls import BALLS
from millisight.meshes._household.boxes import BOXES
from millisight.meshes._household.cans import CANS
from millisight.meshes._household.cases import CASES
from millisight.meshes._household.clamps import CLAMPS
from millisight.meshes._household.cups import CUPS
from millisight.meshes._household.fruit import FRUIT
from millisight.meshes._household.globes import GLOBES
from millisight.meshes._household.mugs import MUGS
from millisight.meshes._household.others import OTHERS
from millisight.meshes._household.tools import TOOLS
from millisight.meshes._household.toys import TOYS
from millisight.meshes._household.tubes import TUBES
from millisight.meshes._household.utensils import UTENSILS

if TYPE_CHECKING:
    from manifold3d import Manifold

HOUSEHOLD: "Mapping[str, tuple[Callable[[np.random.Generator], Manifold], ...]]" = MappingProxyType(
    {
        "can": (*CANS, *TUBES),
        "handle": (*TOOLS, *UTENSILS),
        "box": (*BOXES, *CASES),
        "sphere": (*BALLS, *FRUIT, *GLOBES),
        "cup": (*CUPS, *MUGS),
        "clamp": CLAMPS,
        "other": (*OTHERS, *TOYS),
    }
)
"""What draws each kind, by class."""
