"""See through boxes with millimetre waves: simulate, capture, image, perceive and evaluate.

>>> import millisight as ms
>>> scene = ms.Scene.from_mesh("rubiks_cube", vertices=500)
>>> radar = ms.Radar.preset("mito-sim-24ghz")
>>> capture = ms.simulate(scene, radar, ms.Trajectory.raster(size=(0.1, 0.1), step=0.01), model="edge")
>>> image = ms.form_image(capture, ms.VoxelGrid.regular((-0.05, -0.05, 0), (0.05, 0.05, 0.02), 0.005))
>>> image.values.shape
(21, 21, 5)

Everything is imported when it is first used, so that `import millisight` is fast.
"""

from typing import Any

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("millisight")
    return _public(name)
