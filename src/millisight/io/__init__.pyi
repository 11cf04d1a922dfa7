from ._hdf5 import SCHEMA_VERSION as SCHEMA_VERSION
from ._hdf5 import load as load
from ._hdf5 import load_extras as load_extras
from ._hdf5 import open_capture as open_capture
from ._hdf5 import provenance as provenance
from ._hdf5 import save as save
from ._hdf5 import save_image as save_image
from ._photos import read_photo as read_photo
