"""What speaks against a mask: it may be a lid's, a part of something larger, or of nothing at all."""

import numpy as np

from millisight.data import Mask, SarImage
from millisight.perception import HIGH_BAND, sheets_in, without_sheets
from millisight.perception.segmentation._heights import tells_depths

_ALIKE = 0.6  # intersection over union of a mask with what is flat
_MOST_OF_IT = 0.8  # of an image's power
_AT_EDGE = 0.1  # of a mask's outline that lies on the picture's edge


def doubts_of(mask: Mask, image: SarImage, *, covered: bool = False) -> tuple[str, ...]:
    """Reasons to look at a mask again, as sentences; none where nothing speaks against it.

    Parameters
    ----------
    mask : Mask
    image : in which it was found, on the same pixels
    covered : whether a lid was known to lie over the scene, as `find_mask` was told
    """
    inside = mask.inside
    if not inside.any() or 1 in inside.shape:
        return ()
    doubts = []
    if image.seen_from == "beside":
        doubts.append(
            "the antennas lie beside the picture, which is seen along z; turn the frame so that they look along z"
        )
    padded = np.pad(inside, 1)
    neighbours = [padded[1 + i : padded.shape[0] - 1 + i, 1 + j : padded.shape[1] - 1 + j] for i, j in _BESIDE]
    outline = inside & ~np.logical_and.reduce(neighbours)
    edge = np.ones_like(inside)
    edge[1:-1, 1:-1] = False
    if (outline & edge).sum() > _AT_EDGE * outline.sum():
        doubts.append("the mask runs to the edge of the picture: what it marks may go on beyond; image a larger area")
    if covered and not tells_depths(image, without_sheets(image, frequency=HIGH_BAND, covered=True)):
        doubts.append(
            "the echoes are too long along z to tell an empty carton from a full one, as at 24 GHz alone: image 77 GHz "
            "as well"
        )
    taken = () if covered else sheets_in(image, frequency=HIGH_BAND).sheets
    if taken:
        power = np.square(image.magnitude, dtype=np.float64).sum(axis=2)
        left_out = 1 - float(power[inside].sum() / power.sum())
        if left_out > _MOST_OF_IT:
            doubts.append(
                f"something flat was left out, as lids are, and {100 * left_out:.0f} % of the echo lies outside the "
                "mask; if it is the object, image a few centimetres more around it"
            )
    elif not covered:
        # What would be taken off as a lid if one were known to be there.
        for flat in sheets_in(image, frequency=HIGH_BAND, covered=True).sheets:
            box = flat.box_on(mask.grid_xy)
            if (inside & box).sum() > _ALIKE * (inside | box).sum():
                doubts.append(
                    "the mask covers something flat, which may be a lid or the top of a box; if it is a lid, say so: "
                    "condition='nlos'"
                )
                break
    return tuple(doubts)


_BESIDE = ((-1, 0), (1, 0), (0, -1), (0, 1))
