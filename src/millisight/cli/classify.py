"""`millisight classify`: from images to names, one or a whole dataset."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from millisight.cli.console import check_outputs, say
from millisight.cli.image_sources import (
    MASK_SUFFIX,
    ImageSource,
    check_single,
    image_sources,
    named_segmenter,
    one_by_one,
    read_as,
)
from millisight.cli.options import Images, Multispectral, RadarChoice
from millisight.errors import FileError, InputError
from millisight.files import make_folder, printable, write_text
from millisight.imaging.image import SarImage
from millisight.perception.segmentation import Mask, Segmenter, find_mask

if TYPE_CHECKING:
    from millisight.perception.classification import Classifier, Prediction

_SUFFIX = ".prediction.json"
_DEFAULT_METHOD = "wave"
_BAR = 40  # letters of a probability of 1


@dataclass(frozen=True, slots=True)
class _Settings:
    """The options that are the same for every image."""

    classifier: "Classifier"
    masks: Path | None
    method: str | None
    segmenter: Segmenter
    seed: int
    picture: bool
    as_json: bool
    notes: set[str] = field(default_factory=set)  # that were said


def classify(
    images: Images,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Write all that is known (JSON), and a picture beside it; a folder where there are several images. "
            "[default: only say it]",
        ),
    ] = None,
    mask: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="Which pixels are the object's: what `millisight segment` or `annotate` wrote; of several images the "
            "folder with their masks. [default: NAME.mask.h5 where `segment` writes it, if it is there; else it is "
            "found, with wave]",
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(help="Find the mask anew, with this segmenter: wave, classical or sam."),
    ] = None,
    other_band: Annotated[
        Path | None, typer.Option(help="The same scene at the radar's other frequency; mask and name get better by it.")
    ] = None,
    multispectral: Multispectral = False,
    radar: RadarChoice = None,
    condition: Annotated[
        str | None,
        typer.Option(
            help="los: in line of sight. nlos: behind something; it matters to segmenters that need prompts. "
            "[default: los, or as an experiment's folder is named]"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the drawing of prompts, where the segmenter needs some.")] = 0,
    weights: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.onnx",
            help="A network of your own, as `millisight train classifier` makes it, with its .json beside it. "
            "[default: the one shipped]",
        ),
    ] = None,
    no_picture: Annotated[
        bool, typer.Option("--no-picture", help="With --output: do not draw the mask and the probabilities.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Say all that is known, each image's as one line of JSON.")
    ] = False,
) -> None:
    """Name the object in images; with several images, one bad one does not stop the rest.

    The object's mask is found first, as `millisight segment` finds it. What lies under it is classified by a network
    that learned from simulated images alone. Its probabilities are calibrated: of the answers with 0.8, about 8 in 10
    are right on simulated images. Below its threshold the answer is "not sure", with the most probable classes.

    Example: millisight classify mug.image.h5

    Example: millisight classify mug_77.h5 --other-band mug_24.h5 --mask mug.mask.h5 -o mug.prediction.json

    Example: millisight classify MITO_Dataset/004_sugar_box --multispectral -o predictions/
    """
    if mask is not None and method is not None:
        raise InputError("--mask gives the mask, and --method finds it; leave one of them out")
    found = image_sources(images, radar=radar, condition=condition, multispectral=multispectral, other_band=other_band)
    check_single(found, mask=None if mask is None or mask.is_dir() else mask, other_band=other_band)
    settings = _Settings(
        classifier=_classifier(weights),
        masks=mask,
        method=method,
        segmenter=named_segmenter(method or _DEFAULT_METHOD),
        seed=seed,
        picture=not no_picture,
        as_json=as_json,
    )
    if len(found) == 1 and not any(path.is_dir() for path in images):
        if output is not None and output.suffix.lower() != ".json":
            raise InputError(f"--output is {output}; expected a name that ends in .json")
        prediction = _classify_one(found[0], output, settings)
        if not as_json:
            _say_bars(prediction)
        return
    folder = None if output is None else make_folder(output)
    one_by_one(
        found,
        lambda source: _classify_one(source, None if folder is None else source.output(_SUFFIX, folder), settings),
        verb="classify",
        past="classified",
        tell=_note if as_json else say,
    )


def _classifier(weights: Path | None) -> "Classifier":
    from millisight.perception.classification import Classifier

    try:
        return Classifier(weights)
    except ImportError as error:
        raise InputError(f"classify cannot be used here: {error}") from error


def _classify_one(source: ImageSource, to: Path | None, settings: _Settings) -> "Prediction":
    drawn = to.with_suffix(".png") if to is not None and settings.picture else None
    check_outputs(to, drawn, source=source.path)
    image, other = source.images()
    mask, how = _mask(source, image, other, settings)
    try:
        prediction = settings.classifier.classify(image, mask, other_band=other)
    except InputError as error:
        raise error if how["file"] is None else InputError(f"with the mask of {how['file']}: {error}") from error
    bands = settings.classifier.bands
    if other is None and len(bands) > 1:
        _note_once(
            f"the classifier looks at {' and '.join(bands)}, and gets one band; --other-band, or --multispectral of a "
            "dataset, gives it both",
            settings,
        )
    told = _told(source, prediction, how, settings)
    if to is not None:
        write_text(to, json.dumps(told, indent=2) + "\n")
    if drawn is not None:
        from millisight.viz.classification import plot_prediction
        from millisight.viz.style import save_figure

        figure = plot_prediction(image, mask, prediction)[0].figure
        figure.suptitle(source.name, fontsize=11.5, fontweight="bold")
        save_figure(figure, drawn)
    if settings.as_json:
        say(json.dumps(told))
    else:
        say(f"{source.name}: {_words(prediction)} (mask: {how['file'] or how['method']})")
    return prediction


def _mask(
    source: ImageSource, image: SarImage, other: SarImage | None, settings: _Settings
) -> tuple[Mask, dict[str, Any]]:
    """The object's mask, and where it is from."""
    path = _mask_file(source, settings)
    if path is not None:
        mask = read_as(Mask, path)
        return mask, {"file": str(path), **_made_by(path), "pixels": int(mask.inside.sum())}
    from millisight.perception.projection import project

    found = find_mask(
        settings.segmenter,
        project(image, other_band=other),
        other=None if other is None else project(other),
        rng=settings.seed,
        condition=source.condition,
    )
    return found.mask, {
        "file": None,
        "method": settings.segmenter.name,
        "score": found.score,
        "condition": source.condition,
        "seed": None if found.prompts is None else settings.seed,
        "pixels": int(found.inside.sum()),
    }


def _mask_file(source: ImageSource, settings: _Settings) -> Path | None:
    """The file to read the mask from; None: it is to be found.

    Raises
    ------
    FileError
        The folder with the masks holds none of this image.
    """
    if settings.masks is None:
        beside = source.output(MASK_SUFFIX)
        return beside if settings.method is None and beside.is_file() else None
    if not settings.masks.is_dir():
        return settings.masks
    path = source.output(MASK_SUFFIX, settings.masks)
    if not path.exists():
        raise FileError(
            f"{printable(settings.masks)} holds no mask of {source.name}; expected {printable(path.name)} there: "
            "`millisight segment` may have failed on this image"
        )
    return path


def _made_by(path: Path) -> Mapping[str, Any]:
    """How the mask of a file came about, where `segment` or `annotate` wrote it."""
    from millisight.io.hdf5 import load_extras

    told = None if path.suffix.lower() == ".pkl" else load_extras(path).get("segmentation")
    known = told if isinstance(told, dict) else {}
    return {key: known.get(key) for key in ("method", "score", "condition", "seed")}


def _told(source: ImageSource, prediction: "Prediction", how: Mapping[str, Any], settings: _Settings) -> dict[str, Any]:
    """All that is known, as JSON holds it."""
    from importlib.metadata import version

    from millisight.io.mito_names import origin

    return {
        "name": source.name,
        "answer": prediction.answer,
        "label": prediction.label,
        "confidence": prediction.confidence,
        "sure": prediction.sure,
        "threshold": prediction.threshold,
        "probabilities": dict(zip(prediction.class_names, prediction.probabilities.tolist(), strict=True)),
        "image": origin(source.path),
        "other_band": None if source.other is None else origin(source.other),
        "mask": {**how, "file": None if how["file"] is None else origin(how["file"])},
        "classifier": {
            "name": settings.classifier.name,
            "sha256": settings.classifier.description["sha256"],
            "bands": list(settings.classifier.bands),
        },
        "made_by": f"millisight classify {version('millisight')}",
    }


def _words(prediction: "Prediction") -> str:
    """The answer: "box 0.93", or "not sure: box 0.41, can 0.35"."""
    best = np.argsort(-prediction.probabilities, kind="stable")[: 1 if prediction.sure else 2]
    classes = ", ".join(f"{prediction.class_names[i]} {prediction.probabilities[i]:.2f}" for i in best)
    return classes if prediction.sure else f"{prediction.answer}: {classes}"


def _say_bars(prediction: "Prediction") -> None:
    """A line a class, the most probable first."""
    width = max(map(len, prediction.class_names))
    for i in np.argsort(-prediction.probabilities, kind="stable"):
        share = float(prediction.probabilities[i])
        say(f"  {prediction.class_names[i]:<{width}}  {share:.2f}  {'#' * round(_BAR * share)}".rstrip())
    if prediction.threshold > 0:
        say(f"  sure from {prediction.threshold:.2f}")


def _note_once(line: str, settings: _Settings) -> None:
    if line not in settings.notes:
        settings.notes.add(line)
        _note(line)


def _note(line: str) -> None:
    """Where it does not get between the answers."""
    typer.echo(f"millisight: {line}", err=True)
