"""Segmenters at the speed of clicks: large pictures are looked at more coarsely."""

import math

import numpy as np

from millisight.data import Picture, Prompts
from millisight.perception.segmentation import Candidates, Segmenter


class Coarse:
    """A segmenter that sees means of k x k pixels, at most `most`, and whose masks are of such blocks."""

    def __init__(self, by: Segmenter, most: int) -> None:
        self.name, self.needs_prompts = by.name, by.needs_prompts
        self._by, self._most = by, most

    def segment(self, picture: Picture, prompts: Prompts | None) -> Candidates:
        """Masks (K, A, B), as those of the smaller picture."""
        a, b = picture.shape
        k = math.ceil(math.sqrt(a * b / self._most))
        if k <= 1:
            return self._by.segment(picture, prompts)
        if prompts is not None:
            prompts.check_on(picture)
            prompts = Prompts(points=prompts.points // k, positive=prompts.positive)
        whole = np.pad(picture.rgb, ((0, -a % k), (0, -b % k), (0, 0)), mode="edge")
        blocks = whole.reshape(whole.shape[0] // k, k, whole.shape[1] // k, k, 3)
        small = Picture(rgb=np.round(blocks.mean(axis=(1, 3))).astype(np.uint8))
        found = self._by.segment(small, prompts)
        masks = found.masks.repeat(k, axis=1).repeat(k, axis=2)[:, :a, :b]
        return Candidates(masks=masks, scores=found.scores)
