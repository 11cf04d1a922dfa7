from ._annotation import Annotation as Annotation
from ._annotation import prompts_beside as prompts_beside
from ._annotation import segmenters_for as segmenters_for
from ._server import AnnotatorServer as AnnotatorServer
from ._subject import OpenedPicture as OpenedPicture
from ._subject import open_picture as open_picture
