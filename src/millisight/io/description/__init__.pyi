from ._description import description_in as description_in
from ._description import files_named as files_named
from ._description import read as read
from ._description import read_frames as read_frames
from ._description import read_scan as read_scan
