"""What lies over the object in an image, such as the lid of a carton: where it is, and how to look under it."""
from millisight.core import record
from millisight.data import SarImage
from millisight.viz.viewer._levels import Levels

@record
class Cover:
    lid: float
    ceiling: float
    top_db: float
    levels: Levels | None

def cover_of(image: SarImage, clutter: str) -> Cover | None:
    return None
