"""How each object of the catalogue is drawn: one function an object, or a kind of object.

A sketch takes the size (x, y, z) in millimetres that it has to fill, and returns a solid, or, for an object of
several materials, its parts by name: they may overlap, and the one named first keeps the place. Some are drawn
from that size alone (`can`, `box`, `ball`). The others are drawn by eye and `stretched` over the last few
percent: after the outlines and sections of the YCB scans where there is one to look at, else after the set's
pictures and common ware. What is closed in use (a can, a bottle) is drawn as its outer skin, without the inside.
Positions are in the pose that `objects` describes: x to the right, y up the page, z towards the radar.
"""
