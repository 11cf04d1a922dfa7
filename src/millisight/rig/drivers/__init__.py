"""Drivers of real devices, and the registry that a rig file chooses them from."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
