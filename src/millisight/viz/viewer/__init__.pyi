from ._contents import gather as gather
from ._layout import PaneGrid as PaneGrid
from ._server import start as start
from ._settings import ViewSettings as ViewSettings
from ._share import write_page as write_page
from ._view import view as view
from ._viewer import Viewer as Viewer
from ._viewer import first_settings as first_settings
