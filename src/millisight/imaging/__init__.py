"""From frames to complex images: exact, backprojection, fast; clocks and windows."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
