# pyright: basic
"""Every record, and nothing that computes: meshes, scenes, radars, captures, images, masks, predictions."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
