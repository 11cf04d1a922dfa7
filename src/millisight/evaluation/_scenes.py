"""Scenes with true masks, and segmenters run and scored on them."""

import json
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from millisight.core import check_known, put, record
from millisight.core.errors import InputError
from millisight.data import CameraFrame, Mask, Picture, SarImage
from millisight.evaluation._metrics import MaskScores, score_mask
from millisight.evaluation._truth import pixels_on_grid
from millisight.perception import depth_prompts, photo, project, weights_version
from millisight.perception.segmentation import Segmented, Segmenter, find_mask, segmenter

CAMERA, LOW, HIGH, BOTH = "camera", "24 GHz", "77 GHz", "multi-spectral"
INPUTS = (CAMERA, LOW, HIGH, BOTH)
"""Inputs of a segmenter: a photo; the image of one radar; that at 77 GHz, with prompts where 24 GHz agrees."""
SIGHTS = {"los": "line of sight", "nlos": "out of sight"}
EMPTY = "empty"
"""In the place of a sight: a scene with no object, where nothing is to be found."""


@record
class CameraView:
    """A camera's picture of a scene.

    Attributes
    ----------
    frame : CameraFrame
    T_radar_camera : (4, 4) camera frame to the images' frame [m]
    farthest : depth up to which prompts lie on the object [m]
    """

    frame: CameraFrame
    T_radar_camera: np.ndarray
    farthest: float


@record
class LabelledScene:
    """One object, imaged once, with its true masks.

    Attributes
    ----------
    name : of the scene
    object : of the object, by which networks know it
    sight : "los" or "nlos"
    images : "24 GHz" and "77 GHz", or one of them
    truth : for each image, the object's mask on its grid
    view : what the camera saw; None: nothing
    """

    name: str
    object: str
    sight: str
    images: Mapping[str, SarImage]
    truth: Mapping[str, Mask]
    view: CameraView | None = None

    def __post_init__(self) -> None:
        check_known("kind of sight", self.sight, SIGHTS)
        for name in (*self.images, *self.truth):
            check_known("radar image", name, (LOW, HIGH))
        if not self.images or set(self.images) != set(self.truth):
            raise InputError(
                f"scene {self.name} has images of {', '.join(self.images) or 'nothing'} and truth for "
                f"{', '.join(self.truth) or 'nothing'}; expected a true mask for each image, and at least one image"
            )
        put(self, images=dict(self.images), truth=dict(self.truth))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Those of INPUTS that the scene has; the camera needs a 77 GHz image too, on whose grid it is scored."""
        there = {*self.images}
        if HIGH in there:
            there |= {CAMERA} if self.view is not None else set()
            there |= {BOTH} if LOW in there else set()
        return tuple(name for name in INPUTS if name in there)


def named_segmenter(name: str, options: Mapping[str, Any]) -> Segmenter:
    """The segmenter of that name with its options; one for all scenes of a process."""
    try:
        version = weights_version(options["weights"]) if options.get("weights") else ()
        return _segmenter(name, json.dumps(dict(options), sort_keys=True), version)
    except ImportError as error:
        raise InputError(str(error)) from error


@lru_cache(maxsize=2)
def _segmenter(name: str, options: str, version: tuple[int, ...]) -> Segmenter:
    return segmenter(name, **json.loads(options))


def checksum_of(network: Any) -> str:
    """SHA-256 of the weights of a classifier or a segmenter; "" where it has none."""
    return str(getattr(network, "description", {}).get("sha256", ""))


class MaskAttempt(NamedTuple):
    """One mask.

    Attributes
    ----------
    scores : MaskScores
    mask : that was scored, an empty one where none was found
    found : Segmented; None: nothing
    failure : why nothing was found; "" otherwise
    """

    scores: MaskScores
    mask: Mask
    found: Segmented | None
    failure: str


@record
class MaskTrial:
    """The scores of one mask.

    Attributes
    ----------
    scene, object, sight : of the scene; `EMPTY` is a sight, too
    method : name of the segmenter
    input : one of INPUTS
    seed : of the prompts
    scores : by the name of the metric
    failure : why there is no mask, and an empty one was scored; "" where there is one
    """

    scene: str
    object: str
    sight: str
    method: str
    input: str
    seed: int
    scores: MaskScores
    failure: str = ""


class SegmenterEvaluator:
    """A segmenter on a scene; the pictures of the scene are made once.

    Parameters
    ----------
    by : Segmenter
    scene : LabelledScene
    """

    def __init__(self, by: Segmenter, scene: LabelledScene, *, support: float | None = None):
        self.by: Segmenter = by
        self.scene: LabelledScene = scene
        self.support: float | None = support

    @property
    def inputs(self) -> tuple[str, ...]:
        """Those of the scene that the segmenter takes.

        Only prompts say which object of a photo is meant: a segmenter that needs none is made for radar images. To one
        that does not look all are the same.
        """
        if getattr(self.by, "blind", False):
            return tuple(name for name in (HIGH, LOW) if name in self.scene.images)[:1]
        return tuple(name for name in self.scene.inputs if name != CAMERA or self.by.needs_prompts)

    def attempt(self, given: str, seed: int) -> MaskAttempt:
        """The mask found on one of `inputs`, and its scores; where none is found, those of an empty mask."""
        truth = self.truth(given)
        try:
            found = self._from_photo(seed) if given == CAMERA else self._from_radar(given, seed)
            mask = self._on_grid(found) if given == CAMERA else found.mask
        except InputError as error:
            empty = Mask(grid_xy=truth.grid_xy, inside=np.zeros(truth.grid_xy.shape, bool))
            return MaskAttempt(score_mask(empty, truth), empty, None, str(error))
        return MaskAttempt(score_mask(mask, truth), mask, found, "")

    def truth(self, given: str) -> Mask:
        """The true mask on the grid of `given`."""
        return self.scene.truth[LOW if given == LOW else HIGH]

    def trials(self, seeds: Sequence[int]) -> list[MaskTrial]:
        """All inputs, each with prompts of every seed."""
        sight = self.scene.sight if any(mask.inside.any() for mask in self.scene.truth.values()) else EMPTY
        scene = {"scene": self.scene.name, "object": self.scene.object, "sight": sight}
        found = []
        for given in self.inputs:
            for seed in seeds:
                one = self.attempt(given, seed)
                trial = MaskTrial(
                    **scene, method=self.by.name, input=given, seed=seed, scores=one.scores, failure=one.failure
                )
                found.append(trial)
        return found

    @cached_property
    def pictures(self) -> dict[str, Picture]:
        """By input; that of the camera is the photo."""
        images = self.scene.images
        made = {name: project(image) for name, image in images.items()}
        if BOTH in self.inputs:
            made[BOTH] = project(images[HIGH], other_band=images[LOW])
        if self.scene.view is not None:
            made[CAMERA] = photo(self.scene.view.frame)
        return made

    def _from_radar(self, given: str, seed: int) -> Segmented:
        other = self.pictures[LOW] if given == BOTH else None
        largest = 1.0 if getattr(self.by, "blind", False) else None
        return find_mask(
            self.by, self.pictures[given], other=other, rng=seed, condition=self.scene.sight, largest=largest,
            support=None if getattr(self.by, "blind", False) else self.support,
        )  # fmt: skip

    def _from_photo(self, seed: int) -> Segmented:
        """The mask may be as large as the photo: the rule about large masks is for radar images."""
        view = self._view()
        prompts = depth_prompts(view.frame, farthest=view.farthest, rng=seed)
        return find_mask(self.by, self.pictures[CAMERA], prompts=prompts, largest=1.0)

    def _on_grid(self, found: Segmented) -> Mask:
        view = self._view()
        depth = view.frame.depth * view.frame.depth_unit
        grid = self.scene.images[HIGH].grid.xy
        return pixels_on_grid(found.inside, depth, grid, view.T_radar_camera, intrinsics=view.frame.intrinsics)

    def _view(self) -> CameraView:
        if self.scene.view is None:
            raise InputError(f"scene {self.scene.name} has no camera picture")
        return self.scene.view
