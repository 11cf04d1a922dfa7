"""Images of a dataset as tensors. Importing this module imports torch."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset as TorchBase

from millisight.io.mito import IMAGE, RADAR_MASK


class TorchDataset(TorchBase[Any]):
    """A map-style dataset of radar images for loaders and samplers of torch.

    An item is a dictionary: "image", (X, Y, Z) complex64; "mask", (X, Y) bool, where masks are wanted; "x", "y", "z",
    the voxels' coordinates [m], float64; "name", "object", and "index", the place in this dataset. Images differ in
    size: crop or pad them in `transform` before they are stacked to a batch.

    Parameters
    ----------
    dataset : Dataset; experiments and simulations without such an image (or mask) are left out
    radar : "77_ghz" or "24_ghz"
    ext : "" for measured images; "_specular", "_edges" or "_diffuse" for simulated ones
    mask : give the mask beside the image, too
    transform : called with each item; its answer is what the loader gets
    """

    def __init__(
        self,
        dataset: Iterable[Any],
        *,
        radar: str = "77_ghz",
        ext: str = "",
        mask: bool = False,
        transform: Callable[[dict[str, Any]], Any] | None = None,
    ):
        kinds = (IMAGE, RADAR_MASK) if mask else (IMAGE,)
        wanted = {(kind, radar, ext) for kind in kinds}
        self._parts = [part for part in dataset if wanted <= {(i.kind, i.radar, i.ext) for i in part.items}]
        self._which = {"radar": radar, "ext": ext}
        self._mask = mask
        self._transform = transform

    def __len__(self) -> int:
        return len(self._parts)

    def __getitem__(self, index: int) -> Any:
        part = self._parts[index]
        image = part.image(**self._which)
        item: dict[str, Any] = {
            "image": torch.from_numpy(image.values.astype(np.complex64)),
            **{name: torch.from_numpy(np.array(getattr(image.grid, name))) for name in "xyz"},
            "name": part.name,
            "object": part.object,
            "index": index,
        }
        if self._mask:
            item["mask"] = torch.from_numpy(np.array(part.mask(**self._which).inside))
        return item if self._transform is None else self._transform(item)
