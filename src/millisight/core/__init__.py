"""What every room stands on: errors, checked records, files, the phase law, what compiles kernels, and processes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
