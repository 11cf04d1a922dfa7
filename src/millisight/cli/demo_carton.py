"""The end of `millisight demo`: scissors in a shut carton, as the camera, the radar and the mask see them.

Their raw frames lie in `shut_carton`: a scan by the virtual rig, which examples/shut_carton.py made.
"""

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from millisight.calibration import read_capture
from millisight.cli.classify import answer_words
from millisight.cli.grids import parse_grid
from millisight.data import Mask, Prediction, SarImage
from millisight.imaging import form_image
from millisight.perception import without_sheets

if TYPE_CHECKING:
    from millisight.viz import PageItem

SCAN = Path(__file__).with_name("shut_carton")
BANDS = {"77 GHz": "77_ghz", "24 GHz": "24_ghz"}
FOLDER = "shut_carton"  # in the demo's own


def look_into_carton(output: Path) -> "PageItem":
    """Image, segment and classify the scan; write its files below `output`; returns what the page shows.

    It prints nothing: the demo runs it in another process. The description of each band and its frames are copied as
    well, to try commands on.
    """
    from matplotlib.image import imread

    from millisight.io import save
    from millisight.viz import PageItem, plot_hidden, save_figure

    shutil.copytree(SCAN, output / FOLDER, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    images, captures = {}, {}
    for band, stem in BANDS.items():
        captures[band] = read_capture(output / FOLDER / f"{stem}.toml")
        images[band] = form_image(captures[band], parse_grid(None, captures[band]))
        save(output / f"carton-{band.split()[0]}ghz.image.h5", images[band])
    high, low = images.values()
    mask, prediction, missing = _perceived(high, low)
    if mask is not None:
        save(output / "carton.mask.h5", mask)
    opened, shut = (imread(SCAN / f"{name}.jpg") for name in ("open", "shut"))
    seen = without_sheets(high, covered=True)
    panels = plot_hidden(opened, shut, seen, mask=mask, scale="db", dynamic_range_db=30)
    save_figure(panels[0].figure, output / "carton.png")
    answer = missing if prediction is None else answer_words(prediction)
    caption = (
        "Scissors in a carton whose lid is shut. Left: what a camera sees without the carton. Middle: with it. Right: "
        "the 77 GHz image through the lid, in decibels, the echo of the lid taken off, and the outline of the mask "
        "that the segmenter found in it. The scan is simulated by the virtual rig, which has "
        "other physics than the simulator: physical optics, layers of cardboard, noise, an arm that strays. Its raw "
        f"frames and their descriptions are in the folder {FOLDER}."
    )
    facts = {
        f"capture at {band}": f"{one.channels} positions, {one.radar.waveform.samples_per_chirp} samples each"
        for band, one in captures.items()
    }
    return PageItem(
        heading="Scissors in a shut carton",
        picture="carton.png",
        caption=caption,
        facts={**facts, "image": " x ".join(map(str, high.grid.shape)) + " voxels", "class": answer},
    )


def _perceived(image: SarImage, other: SarImage) -> tuple[Mask | None, Prediction | None, str]:
    """Mask, by 77 GHz alone, as the picture shows, and class, by both bands; or why there are none."""
    from millisight.perception.classification import classify
    from millisight.perception.segmentation import segment

    try:
        mask = segment(image, condition="nlos")
        if not mask.inside.any():
            return mask, None, "nothing was found"
        return mask, classify(image, mask, other_band=other, condition="nlos"), ""
    except ImportError as error:
        return None, None, f"not segmented: {error}"
