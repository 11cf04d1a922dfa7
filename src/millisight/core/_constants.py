"""Physical constants, written once. The speed of light is exact by definition of the metre."""

SPEED_OF_LIGHT = 299_792_458.0
"""Speed of light in vacuum [m/s]."""
