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

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from millisight.capture.camera import CameraFrame as CameraFrame
    from millisight.capture.camera import CameraMask as CameraMask
    from millisight.capture.camera import Intrinsics as Intrinsics
    from millisight.capture.capture import Capture as Capture
    from millisight.capture.clock import ClockCorrection as ClockCorrection
    from millisight.capture.clock import retime as retime
    from millisight.capture.noise import add_noise as add_noise
    from millisight.capture.radar import AntennaArray as AntennaArray
    from millisight.capture.radar import Radar as Radar
    from millisight.capture.radar import Waveform as Waveform
    from millisight.capture.scan import RawScan as RawScan
    from millisight.capture.scan import ScanRow as ScanRow
    from millisight.capture.simulate import simulate as simulate
    from millisight.capture.trajectory import Trajectory as Trajectory
    from millisight.evaluation.alignment import Alignment as Alignment
    from millisight.evaluation.alignment import align as align
    from millisight.evaluation.f_score import FScore as FScore
    from millisight.evaluation.f_score import f_score as f_score
    from millisight.evaluation.point_cloud import PointCloud as PointCloud
    from millisight.evaluation.point_cloud import point_cloud as point_cloud
    from millisight.evaluation.point_cloud import write_point_cloud as write_point_cloud
    from millisight.imaging.exact import image_at as image_at
    from millisight.imaging.form import form_image as form_image
    from millisight.imaging.grid import PixelGrid as PixelGrid
    from millisight.imaging.grid import VoxelGrid as VoxelGrid
    from millisight.imaging.image import SarImage as SarImage
    from millisight.imaging.image import combine as combine
    from millisight.imaging.synchronise import estimate_clock as estimate_clock
    from millisight.io.description import read_capture as read_capture
    from millisight.io.description import read_scan as read_scan
    from millisight.io.hdf5 import load as load
    from millisight.io.hdf5 import open_capture as open_capture
    from millisight.io.hdf5 import save as save
    from millisight.perception.classification import Classifier as Classifier
    from millisight.perception.classification import Prediction as Prediction
    from millisight.perception.classification import classify as classify
    from millisight.perception.projection import Picture as Picture
    from millisight.perception.projection import project as project
    from millisight.perception.prompts import Prompts as Prompts
    from millisight.perception.prompts import power_prompts as power_prompts
    from millisight.perception.segmentation import Mask as Mask
    from millisight.perception.segmentation import segment as segment
    from millisight.perception.segmentation import segmenter as segmenter
    from millisight.scene.material import Material as Material
    from millisight.scene.mesh import TriangleMesh as TriangleMesh
    from millisight.scene.scene import Scene as Scene
    from millisight.scene.scene import SceneObject as SceneObject

_HOMES = {
    "Alignment": "evaluation.alignment",
    "AntennaArray": "capture.radar",
    "CameraFrame": "capture.camera",
    "CameraMask": "capture.camera",
    "Capture": "capture.capture",
    "Classifier": "perception.classification",
    "ClockCorrection": "capture.clock",
    "FScore": "evaluation.f_score",
    "Intrinsics": "capture.camera",
    "Mask": "perception.segmentation",
    "Material": "scene.material",
    "Picture": "perception.projection",
    "PixelGrid": "imaging.grid",
    "PointCloud": "evaluation.point_cloud",
    "Prediction": "perception.classification",
    "Prompts": "perception.prompts",
    "Radar": "capture.radar",
    "RawScan": "capture.scan",
    "SarImage": "imaging.image",
    "ScanRow": "capture.scan",
    "Scene": "scene.scene",
    "SceneObject": "scene.scene",
    "Trajectory": "capture.trajectory",
    "TriangleMesh": "scene.mesh",
    "VoxelGrid": "imaging.grid",
    "Waveform": "capture.radar",
    "add_noise": "capture.noise",
    "align": "evaluation.alignment",
    "classify": "perception.classification",
    "combine": "imaging.image",
    "estimate_clock": "imaging.synchronise",
    "f_score": "evaluation.f_score",
    "form_image": "imaging.form",
    "image_at": "imaging.exact",
    "load": "io.hdf5",
    "open_capture": "io.hdf5",
    "point_cloud": "evaluation.point_cloud",
    "power_prompts": "perception.prompts",
    "project": "perception.projection",
    "read_capture": "io.description",
    "read_scan": "io.description",
    "retime": "capture.clock",
    "save": "io.hdf5",
    "segment": "perception.segmentation",
    "segmenter": "perception.segmentation",
    "simulate": "capture.simulate",
    "write_point_cloud": "evaluation.point_cloud",
}

__all__ = [*_HOMES, "__version__"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("millisight")
    if name not in _HOMES:
        raise AttributeError(f"module 'millisight' has no attribute {name!r}")
    value = getattr(import_module(f"millisight.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
