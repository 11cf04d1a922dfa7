"""Whole scenes to train on, made in a moment: a coarse object, and sheets that are drawn, not simulated."""

import numpy as np

from millisight.perception import SPACING
from millisight.perception.training import BANDS, SceneSettings, WholeSettings, compose, make_scene
from millisight.perception.training._bands import DEPTH
from millisight.perception.training._sheets import SheetParts

COARSE = {"vertices": 300, "positions": 400}
PLAIN = WholeSettings(views=1, empty=0.0, several=0.0, sheets=0)


def drawn_sheet(tilt_deg=1.0, side=91, level=9):
    """A sheet as its image has it: a lobe along z, a phase that follows its tilt, and no edge."""
    x = SPACING * (np.arange(side) - side // 2)
    z = DEPTH * (np.arange(15) - level)
    images = {}
    for band, (frequency, width) in zip(BANDS, ((79e9, 0.03), (24.1e9, 0.3)), strict=True):
        phase = 4 * np.pi * frequency / 3e8 * np.tan(np.radians(tilt_deg)) * x
        images[band] = (np.exp(1j * phase)[:, None, None] * np.ones(side)[:, None] * np.sinc(z / width)).astype(
            np.complex64
        )
    return SheetParts(level, np.array([-0.4, 0.4, -0.4, 0.4]), images)


def object_parts(name="dice", seed=2, **settings):
    return make_scene(name, SceneSettings(**{**COARSE, **settings}), rng=np.random.default_rng(seed))


def whole_scene(*parts, seed=1, **settings):
    """A scene of objects, without sheets unless `settings` say so."""
    made = WholeSettings(**{"views": 1, "empty": 0.0, "several": 0.0, "covered": 0.0, **settings})
    return compose(parts or (object_parts(),), [drawn_sheet] * 3, made, np.random.default_rng(seed))
