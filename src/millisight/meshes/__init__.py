"""Where meshes come from: files, the catalogue of objects, random shapes; resampling; rays."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
