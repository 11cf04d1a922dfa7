from ._closed import closed as closed
from ._points import FALSE_ALARMS as FALSE_ALARMS
from ._points import surface_points as surface_points
from ._surface import LEAST_POINTS as LEAST_POINTS
from ._surface import depth_map as depth_map
from ._surface import surface as surface
