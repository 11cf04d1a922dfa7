"""`millisight classify`: from images to names, one or a whole dataset."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from millisight.cli.console import answer, complain, json_only, progress, say
from millisight.cli.image_sources import (
    MASK_SUFFIX,
    ImageSource,
    about,
    check_single,
    image_sources,
    named_segmenter,
    one_by_one,
)
from millisight.cli.options import Images, Multispectral, RadarChoice
from millisight.cli.outputs import check_outputs, folders_of_many, is_folder, of_folder, output_path
from millisight.cli.segment import Condition, OtherBand, PromptSeed, mask_of
from millisight.cli.segment_outputs import fingerprint
from millisight.core import printable, write_text
from millisight.core.errors import FileError, FormatError, InputError
from millisight.data import Instances, Mask, SarImage, grid_difference
from millisight.io import load
from millisight.io.mito import origin, read_published

if TYPE_CHECKING:
    from millisight.data import Prediction
    from millisight.perception.classification import Classifier

_SUFFIX = ".prediction.json"
_DEFAULT_METHOD = "wave"
_BAR = 40  # letters of a probability of 1


def classify(
    images: Images,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="PATH",
            parser=output_path,
            help="Write the full result as JSON, and a picture beside it; a folder for several images. [default: only "
            "print it]",
        ),
    ] = None,
    mask: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="Mask of the object, from `millisight segment` or `annotate`, or of several, from `segment "
            "--instances`: each is classified; for several images, the folder with their masks, or a dataset that has "
            "them beside the images. [default: NAME.mask.h5 if `segment` wrote one; else segment with wave]",
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="Segment with this method, even if there is a mask: wave, classical, sam or the name of a plug-in."
        ),
    ] = None,
    other_band: OtherBand = None,
    multispectral: Multispectral = False,
    radar: RadarChoice = None,
    condition: Condition = None,
    seed: PromptSeed = 0,
    weights: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.onnx",
            help="Weights of a network of your own, from `millisight train classifier`, with its .json beside it. "
            "[default: the shipped one]",
        ),
    ] = None,
    no_picture: Annotated[
        bool, typer.Option("--no-picture", help="With --output: do not plot the mask and the probabilities.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the full result, one line of JSON for each image or object.")
    ] = False,
) -> None:
    """Classify the object in each image. An image that fails does not stop the others.

    The object is segmented first, as by `millisight segment`. A network trained only on simulated images then
    classifies it. The probabilities are calibrated on simulated images: of the answers with probability 0.8, about 8 in
    10 are right. Below the network's threshold the answer is "not sure", followed by the most probable classes; so it
    is for an image unlike those of the training: of an empty scene, a lid, or a scan too sparse.

    Example: millisight classify mug.image.h5

    Example: millisight classify mug_77.h5 --other-band mug_24.h5 --mask mug.mask.h5 -o mug.prediction.json

    Example: millisight classify MITO_Dataset/004_sugar_box --multispectral -o predictions/
    """
    if mask is not None and method is not None:
        raise InputError("--mask and --method cannot be combined: pass a mask, or a method to find one")
    with json_only(as_json):
        found = image_sources(
            images, radar=radar, condition=condition, multispectral=multispectral, other_band=other_band
        )
    check_single(found, mask=None if mask is None or mask.is_dir() else mask, other_band=other_band)
    from millisight.perception.classification import classify as classify_object

    with progress("load the classifier", compiles=False):
        classifier = _classifier(weights)
    by = named_segmenter(method or _DEFAULT_METHOD)
    notes: set[str] = set()

    tell = complain if as_json else say

    def one(source: ImageSource, to: Path | None) -> "list[Prediction]":
        drawn = None if to is None or no_picture else to.with_suffix(".png")
        described = None if weights is None else weights.with_suffix(".json")
        path = _mask_file(source, mask, method)
        masks = [] if path is None else _masks_of(path)
        pictures = _pictures_of(drawn, max(len(masks), 1))
        check_outputs(to, *pictures, source=source.path, others=(source.other, described))
        image, other = source.images()
        if path is not None and mask is None and (why := _not_of(path, masks[0], image)):
            tell(f"{printable(path)} {why}; segmenting anew: the file stays as it is")
            path = None
        if path is None:
            segmented = mask_of(source, image, other, by, seed=seed)
            masks = [segmented.mask]
            made = {
                "file": None,
                "method": by.name,
                "score": segmented.score,
                "condition": source.condition,
                "seed": None if segmented.prompts is None else seed,
            }
        else:
            made = {"file": str(path), **_made_by(path)}
        predictions, results = [], []
        for number, inside in enumerate(masks, 1):
            try:
                prediction = classify_object(
                    image, inside, other_band=other, method=classifier, condition=source.condition
                )
            except InputError as error:
                raise error if path is None else InputError(f"with the mask of {path}: {error}") from error
            of_mask = {**made, "pixels": int(inside.inside.sum())}
            if len(masks) > 1:
                of_mask["object"] = number
            predictions.append(prediction)
            results.append(_result(source, prediction, of_mask, classifier))
        if other is None and len(classifier.bands) > 1:
            note = (
                f"note: the classifier uses {' and '.join(classifier.bands)}, but got one band; pass the other with "
                "--other-band, or a dataset with --multispectral"
            )
            if note not in notes:
                notes.add(note)
                typer.echo(note, err=True)
        if to is not None:
            write_text(to, json.dumps(results[0] if len(results) == 1 else {"objects": results}, indent=2) + "\n")
        for number, (picture, inside, prediction) in enumerate(zip(pictures, masks, predictions, strict=False), 1):
            from millisight.viz import plot_prediction, save_figure

            figure = plot_prediction(image, inside, prediction)[0].figure
            figure.suptitle(_named(source, number, masks), fontsize=11.5, fontweight="bold")
            save_figure(figure, picture)
        for number, (prediction, result) in enumerate(zip(predictions, results, strict=True), 1):
            words = f"{_named(source, number, masks)}: {answer_words(prediction)}"
            answer(json.dumps(result) if as_json else f"{words} (mask: {made['file'] or made['method']})")
        return predictions

    output = of_folder(output) if any(map(is_folder, images)) else output
    if len(found) == 1 and not is_folder(output):
        if output is not None and output.suffix.lower() != ".json":
            raise InputError(f"--output is {output}; expected a name that ends in .json")
        with about(found[0].path):
            predictions = one(found[0], output)
        if not as_json and len(predictions) == 1:
            _say_bars(predictions[0])
        return
    (folder,) = folders_of_many(output, count=len(found))
    one_by_one(
        found,
        lambda source: one(source, None if folder is None else source.output(_SUFFIX, folder)),
        verb="classify",
        past="classified",
        tell=tell,
    )


def _classifier(weights: Path | None) -> "Classifier":
    from millisight.perception.classification import classifier

    try:
        return classifier(weights=weights)
    except ImportError as error:
        raise InputError(f"cannot classify: {error}") from error


def _mask_file(source: ImageSource, masks: Path | None, method: str | None) -> Path | None:
    """The file to read the mask from; None: segment. An error if the folder with the masks holds none of this image."""
    if masks is None:
        beside = source.output(MASK_SUFFIX)
        return beside if method is None and beside.is_file() else None
    if not masks.is_dir():
        return masks
    path = source.output(MASK_SUFFIX, masks)
    found = next((one for one in (path, *_published_masks(source, masks)) if one.is_file()), None)
    if found is None:
        raise FileError(
            f"{printable(masks)} holds no mask of {source.name}; expected {printable(path.name)} there: "
            "`millisight segment` may have failed on this image"
        )
    return found


def _masks_of(path: Path) -> list[Mask]:
    """The mask in a file, or those of several objects."""
    held = read_published(path).record if path.suffix.lower() == ".pkl" else load(path)
    if isinstance(held, Mask):
        return [held]
    if not isinstance(held, Instances):
        raise FormatError(f"{printable(path)} holds a record of {type(held).__name__}; expected a mask or instances")
    if not len(held):
        raise InputError(f"{printable(path)} holds no object: there is nothing to classify")
    return list(held)


def _pictures_of(drawn: Path | None, count: int) -> list[Path]:
    """The files of the pictures of so many objects."""
    if drawn is None or count == 1:
        return [] if drawn is None else [drawn]
    return [drawn.with_suffix(f".{number}.png") for number in range(1, count + 1)]


def _named(source: ImageSource, number: int, masks: Sequence[Mask]) -> str:
    """What the answer about one of several masks is about."""
    return source.name if len(masks) == 1 else f"{source.name}, object {number}"


def _published_masks(source: ImageSource, masks: Path) -> list[Path]:
    """Where the published layout has the mask of an image: beside it, or at the same place below the folder."""
    name = source.path.stem.replace("processed_image", "radar_masks", 1)
    if name == source.path.stem:
        return []
    beside = [source.path.with_name(name + suffix) for suffix in (".pkl", ".h5")]
    below = masks.resolve() in source.path.resolve().parents
    return [path if below else masks / origin(path) for path in beside]


def _not_of(path: Path, mask: Mask, image: SarImage) -> str:
    """Why a mask that lies beside an image is not of it, as where another image has taken its name; "" if it may be."""
    if grid_difference(mask.grid_xy, image.grid.xy):
        return "has other pixels than the image"
    made_of = _segmentation(path).get("fingerprint")
    return "is of another image" if made_of is not None and made_of != fingerprint(image) else ""


def _segmentation(path: Path) -> Mapping[str, Any]:
    """What `segment` or `annotate` wrote beside the mask of a file."""
    from millisight.io import load_extras

    held = None if path.suffix.lower() == ".pkl" else load_extras(path).get("segmentation")
    return held if isinstance(held, dict) else {}


def _made_by(path: Path) -> Mapping[str, Any]:
    """How the mask of a file was made."""
    known = _segmentation(path)
    return {key: known.get(key) for key in ("method", "score", "condition", "seed")}


def _result(
    source: ImageSource, prediction: "Prediction", mask: Mapping[str, Any], classifier: "Classifier"
) -> dict[str, Any]:
    """The full result, as JSON holds it."""
    from importlib.metadata import version

    from millisight.io.mito import origin

    return {
        "name": source.name,
        "answer": prediction.answer,
        "label": prediction.label,
        "confidence": prediction.confidence,
        "sure": prediction.sure,
        "threshold": prediction.threshold,
        "novelty": prediction.novelty,
        "novelty_limit": prediction.novelty_limit,
        "reasons": list(prediction.reasons),
        "unproven": prediction.unproven,
        "probabilities": dict(zip(prediction.class_names, prediction.probabilities.tolist(), strict=True)),
        "image": origin(source.path),
        "other_band": None if source.other is None else origin(source.other),
        "mask": {**mask, "file": None if mask["file"] is None else origin(mask["file"])},
        "classifier": {
            "name": classifier.name,
            "sha256": classifier.description.get("sha256"),
            "bands": list(classifier.bands),
        },
        "made_by": f"millisight classify {version('millisight')}",
    }


def answer_words(prediction: "Prediction") -> str:
    """The answer: "box 0.93", "not sure: box 0.41, can 0.35", or "not sure, the mask looks like a lid: box 0.93"."""
    best = (-prediction.probabilities).argsort(kind="stable")[: 1 if prediction.sure else 2]
    classes = ", ".join(f"{prediction.class_names[i]} {prediction.probabilities[i]:.2f}" for i in best)
    why = "; ".join(prediction.reasons) or "unlike the training images"
    told = f", {why} (novelty {prediction.novelty:.2f})" if prediction.novel else ""
    if prediction.unproven and not prediction.novel:
        told = f", {prediction.unproven}"
    return classes if prediction.sure else f"{prediction.answer}{told}: {classes}"


def _say_bars(prediction: "Prediction") -> None:
    """A line a class, the most probable first."""
    width = max(map(len, prediction.class_names))
    for i in (-prediction.probabilities).argsort(kind="stable"):
        share = float(prediction.probabilities[i])
        say(f"  {prediction.class_names[i]:<{width}}  {share:.2f}  {'#' * round(_BAR * share)}".rstrip())
    if prediction.threshold > 0:
        say(f"  threshold: {prediction.threshold:.2f}")
    if prediction.novelty_limit < 1:
        say(f"  novelty: {prediction.novelty:.2f}, at most {prediction.novelty_limit:.2f} to be sure")
