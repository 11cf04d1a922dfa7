"""Perception: pictures of an image, prompts and networks; the rooms segment, classify and train with them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
