"""Captures by description: a TOML file says where axes, units, sign and positions are."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
