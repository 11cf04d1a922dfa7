from ._classifiers import PaperNetwork as PaperNetwork
from ._classifiers import SmallNetwork as SmallNetwork
from ._classifiers import classifier_network as classifier_network
from ._released import ReleasedNetwork as ReleasedNetwork
from ._released import read_released as read_released
from ._wave import WaveNetwork as WaveNetwork
