"""Segment Anything, through `transformers`: pictures in, masks out; torch stays inside.

SAM and SAM 2 differ in how a picture fits their square: SAM fills its lower or right part with nothing, SAM 2 stretches
it. Both see a picture's first axis as rows and its second as columns.
"""

import hashlib
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_known, checked_record, printable
from millisight.core.errors import DeviceError, FileError, FormatError, InputError
from millisight.data import Picture, Prompts
from millisight.perception.segmentation._segmentation import SEGMENTERS, Candidates

MODELS = {
    "vit-b": "facebook/sam-vit-base",
    "vit-l": "facebook/sam-vit-large",
    "vit-h": "facebook/sam-vit-huge",
    "sam2-tiny": "facebook/sam2.1-hiera-tiny",
    "sam2-large": "facebook/sam2.1-hiera-large",
}
"""Short names of models on the hub."""
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of red, green and blue, as both models were trained
_KEPT = 8  # embeddings of the pictures seen last; 4 MB each for SAM


@SEGMENTERS.add("sam")
class SamSegmenter:
    """Segment Anything (Kirillov et al. 2023), prompted with points.

    Three masks are offered, the best first by the network's own estimate of their IoU. A picture's embedding, which is
    nearly all of the work, is computed once: further prompts on the same picture are answered from it.

    Parameters
    ----------
    model : a folder that `save_pretrained` wrote, one of MODELS, or an id on the hub, from which it is downloaded;
        weights are read from safetensors only, so that no file runs code
    device : "cpu" or "cuda"

    Raises
    ------
    FileError
        There is no such model, it cannot be downloaded, or lacks weights.
    FormatError
        It is none of Segment Anything.
    DeviceError
        "cuda" without a GPU that torch can use.
    ImportError
        torch or transformers is not installed: `pip install "millisight[train]"`.
    """

    name = "sam"
    needs_prompts = True

    def __init__(self, model: str | Path = "vit-b", device: str = "cpu"):
        source = _source(str(model))
        try:
            import torch
            import transformers
        except ImportError as error:
            raise ImportError('"sam" needs torch and transformers: pip install "millisight[train]"') from error
        check_known("device", device, ("cpu", "cuda"))
        if device == "cuda" and not torch.cuda.is_available():
            raise DeviceError('device="cuda" found no GPU that torch can use; use device="cpu"')
        self._device = device
        self._model, self._stretches = _loaded(transformers, str(model), source)
        self._model = self._model.eval().to(device)
        self._size = int(self._model.config.prompt_encoder_config.image_size)
        self._embeddings: OrderedDict[bytes, Any] = OrderedDict()

    def segment(self, picture: Picture, prompts: Prompts | None) -> Candidates:
        """Three masks, (3, A, B), by falling estimate of their IoU.

        Raises
        ------
        InputError
            There are no prompts, or they lie beside the picture.
        """
        import torch

        checked_record(picture, Picture, name="picture")
        if prompts is None:
            raise InputError('"sam" needs prompts, and got none; draw some with power_prompts')
        prompts.check_on(picture)
        height, width = self._fitted(picture.shape)
        scale = np.array([width / picture.shape[1], height / picture.shape[0]], np.float32)
        points = prompts.points[:, ::-1].astype(np.float32) * scale  # (column, row), as the networks have it
        with torch.inference_mode():
            found = self._model(
                image_embeddings=self._embedding(picture),
                input_points=torch.from_numpy(points)[None, None].to(self._device),
                input_labels=torch.from_numpy(prompts.positive.astype(np.int32))[None, None].to(self._device),
                multimask_output=True,
            )
            full = _resized(found.pred_masks[0], (self._size, self._size))[..., :height, :width]
            masks = (_resized(full, picture.shape)[0] > 0).cpu().numpy()
        scores = found.iou_scores[0, 0].float().cpu().numpy()
        order = np.argsort(-scores, kind="stable")
        return Candidates(masks=masks[order], scores=scores[order])

    def _fitted(self, shape: tuple[int, int]) -> tuple[int, int]:
        """Rows and columns of a picture in the network's square."""
        if self._stretches:
            return self._size, self._size
        scale = self._size / max(shape)
        return round(shape[0] * scale) or 1, round(shape[1] * scale) or 1

    def _embedding(self, picture: Picture) -> Any:
        """Of the picture, which is known by its pixels."""
        key = hashlib.sha256(repr(picture.shape).encode() + picture.rgb.tobytes()).digest()
        if key not in self._embeddings:
            self._embeddings[key] = self._model.get_image_embeddings(self._pixels(picture.rgb))
            if len(self._embeddings) > _KEPT:
                self._embeddings.popitem(last=False)
        self._embeddings.move_to_end(key)
        found = self._embeddings[key]
        return list(found) if isinstance(found, list | tuple) else found

    def _pixels(self, rgb: np.ndarray) -> Any:
        """(1, 3, S, S) float32, as the network was trained to see it."""
        import torch

        height, width = self._fitted(rgb.shape[:2])
        channels = torch.from_numpy(rgb.copy()).to(self._device).permute(2, 0, 1)[None].float() / 255
        fitted = _resized(channels, (height, width), antialias=True)
        mean, std = (torch.tensor(values, device=self._device).view(1, 3, 1, 1) for values in (_MEAN, _STD))
        return torch.nn.functional.pad((fitted - mean) / std, (0, self._size - width, 0, self._size - height))


def _resized(values: Any, size: tuple[int, int], *, antialias: bool = False) -> Any:
    import torch

    return torch.nn.functional.interpolate(
        values.float(), size=size, mode="bilinear", align_corners=False, antialias=antialias
    )


def _source(name: str) -> str:
    """The folder, or the id on the hub, that a name stands for."""
    if Path(name).is_dir():
        return name
    source = MODELS.get(name, name)
    if source.count("/") != 1 or source.startswith((".", "/", "~")):
        raise FileError(
            f"{printable(name)} is not a folder with a model; expected one that `save_pretrained` wrote, an id on the "
            f"hub such as {MODELS['vit-b']}, or one of {', '.join(MODELS)}"
        )
    return source


def _loaded(transformers: Any, name: str, source: str) -> tuple[Any, bool]:
    """The network, and whether it stretches pictures; every weight must be there."""
    local = Path(source).is_dir()
    try:
        kind = transformers.AutoConfig.from_pretrained(source, local_files_only=local).model_type
        cls = {"sam": "SamModel", "sam2": "Sam2Model", "sam2_video": "Sam2Model"}.get(kind)
        if cls is None:
            raise FormatError(f"{printable(name)} holds a model of type {kind}; expected sam or sam2")
        model, report = getattr(transformers, cls).from_pretrained(
            source, local_files_only=local, use_safetensors=True, output_loading_info=True
        )
    except FileError:
        raise
    except Exception as error:  # whatever transformers, the hub's client or safetensors raise of a bad or absent file
        reason = " ".join(str(error).split())[:300]
        raise FileError(
            f"the model {printable(name)} cannot be loaded: {reason}; check its name, the network, and that its folder "
            "holds config.json and model.safetensors"
        ) from error
    wanting = sorted(report["missing_keys"]) or sorted(map(str, report["mismatched_keys"]))
    if wanting:
        raise FormatError(
            f"the model {printable(name)} lacks {len(wanting)} of its weights, such as {wanting[0]}; download it again"
        )
    return model, cls == "Sam2Model"
