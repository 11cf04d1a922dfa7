"""Where to measure a scene from: an aperture over it, and whether one covers it."""

import numpy as np

from millisight.core import checked_number, checked_numbers, checked_record
from millisight.core.errors import CoverageError, InputError
from millisight.data import Radar, Scene, Trajectory
from millisight.simulation._steps import needed_step

MARGIN = 0.05
"""By how much an aperture stands out around an object on every side, where nothing is said [m]."""

VIEW_MARGIN = 0.02
"""By how much an image stands out around an object on every side, where nothing is said [m]."""

_WIDEST = 10.0  # that an aperture is by itself [m]: one stray vertex at 100 m made a capture of gigabytes
_PLACES = 16  # along each side, from which a view's angles are taken
_OFF = 1e-3  # by which a scene may stand out on one side [m]: resampling moves its middle by less


def aperture_over(
    scene: Scene,
    radar: Radar,
    *,
    size: tuple[float, float] | None = None,
    step: float | None = None,
    height: float = 0.2,
    center: tuple[float, float, float] | None = None,
) -> Trajectory:
    """A planar raster over a scene.

    Parameters
    ----------
    scene : the objects
    radar : its wavelength determines the default step
    size : along x and y [m]; None: 5 cm beyond the scene on every side
    step : between neighbouring positions [m]; None: half a wavelength at the centre frequency, or less where an image
        of the scene and 2 cm around it would have ghosts
    height : over `center` [m]
    center : (3,) point below the centre of the aperture [m]; None: the centre of the scene's bounding box

    Raises
    ------
    InputError
        An argument cannot be right, or the scene is very wide and `size` is not stated.

    Examples
    --------
    >>> scene = Scene.from_mesh("golf_ball", vertices=200)
    >>> aperture_over(scene, Radar.preset("mito-sim-24ghz"), height=0.15)
    Trajectory(529 poses, x -0.0684 to 0.0683 m, y -0.06838 to 0.06831 m, z 0.15 to 0.15 m)
    """
    bounds = checked_record(scene, Scene, name="scene").mesh.bounds
    wavelength = checked_record(radar, Radar, name="radar").waveform.wavelength
    wide = np.ptp(bounds, axis=0)[:2] + 2 * MARGIN
    height = checked_number(height, name="height", unit="m")
    x, y, z = bounds.mean(axis=0) if center is None else checked_numbers(center, name="center", count=3, unit="m")
    if size is None and wide.max() > _WIDEST:
        raise InputError(
            f"the scene is {wide[0]:.3g} m x {wide[1]:.3g} m wide with its margin; expected {_WIDEST:g} m at most "
            "for an aperture of its size: remove stray vertices, check the unit, or state the aperture's size"
        )
    size, middle = (wide[0], wide[1]) if size is None else size, (x, y, z + height)
    if step is not None:
        return Trajectory.raster(size=size, step=step, center=middle)
    extent = np.array(checked_numbers(size, name="size", count=2, repeat=True, unit="m", minimum=0))
    places = Trajectory.raster(size=size, step=tuple(np.maximum(extent / _PLACES, 1e-3)), center=middle).positions
    antennas, view = places[:, None], bounds + VIEW_MARGIN * np.array([[-1.0], [1.0]])
    needed = (needed_step(radar, axis, antennas, antennas, view, bounds) for axis in np.eye(3)[:2])
    steps = [min(wavelength / 2, one) for one in needed]
    return Trajectory.raster(size=size, step=(steps[0], steps[1]), center=middle)


def check_coverage(scene: Scene, trajectory: Trajectory) -> None:
    """Refuse an aperture that is too small or too low for the scene.

    Raises
    ------
    CoverageError
    """
    lower, upper = checked_record(scene, Scene, name="scene").mesh.bounds
    checked_record(trajectory, Trajectory, name="trajectory")
    first, last = trajectory.positions.min(axis=0), trajectory.positions.max(axis=0)
    for i, name in enumerate("xy"):
        if upper[i] - lower[i] > last[i] - first[i] + 1e-9:
            raise CoverageError(
                f"the object is {(upper[i] - lower[i]) * 100:.1f} cm wide along {name}, the aperture only "
                f"{(last[i] - first[i]) * 100:.1f} cm; enlarge the aperture, rotate the object, or check the mesh's "
                "unit"
            )
        if lower[i] < first[i] - _OFF or upper[i] > last[i] + _OFF:
            raise CoverageError(
                f"the object lies at {name} {lower[i]:.3f} to {upper[i]:.3f} m, the aperture at {name} "
                f"{first[i]:.3f} to {last[i]:.3f} m; move one of them"
            )
    middle = (lower[2] + upper[2]) / 2
    if upper[2] >= first[2]:
        raise CoverageError(
            f"the object reaches {(upper[2] - middle) * 100:.1f} cm above its centre, the aperture hangs at "
            f"{(first[2] - middle) * 100:.1f} cm; raise the aperture or rotate the object"
        )
