"""From raw frames to captures: placing frames along the path, clocks, gains, phases, backgrounds."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
