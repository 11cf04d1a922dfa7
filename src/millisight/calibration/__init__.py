"""From raw frames to captures: placing frames, clocks, gains, phases, backgrounds; and where a camera is on the arm."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
