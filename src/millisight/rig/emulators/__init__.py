"""Emulators of devices, which speak the devices' protocols over real sockets and serial lines."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
