"""What lies between antennas and scene is not air: a medium all around, plane layers; or waves that go one way only.

The imagers know paths through air there and back, bent by plane layers at most. Each step here turns a capture into one
that has them: its frequencies, its path offset and its antennas are such that the phase 2 pi f d / c is the same.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from millisight.calibration._calibrate import remade
from millisight.core import checked_array, checked_number, checked_numbers, checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import Capture, Layers, Trajectory, Waveform

_RAYS = 400


def set_medium(capture: Capture, permittivity: float) -> Capture:
    """Convert a capture of a scene inside a homogeneous medium to the equivalent capture in air.

    A path d in the medium turns the phase by 2 pi f n d / c, n the root of the permittivity. So the frequencies are
    times n, which is what the wavelengths in the medium say, and the path offset, which lies in cables, is over n.

    Parameters
    ----------
    permittivity : relative, real

    Raises
    ------
    InputError
        The permittivity is no number above 0.
    """
    checked_record(capture, Capture, name="capture")
    _check_no_layers(capture)
    permittivity = checked_number(permittivity, name="permittivity", above=0)
    index = float(np.sqrt(permittivity))
    radar = capture.radar
    changed = replace(radar, waveform=_scaled(radar.waveform, index), path_offset=radar.path_offset / index)
    settings = {"permittivity": permittivity, "frequencies_times": index}
    return remade(capture, "set_medium", settings, radar=changed)


def set_one_way(capture: Capture) -> Capture:
    """Convert a one-way capture, from the scene to the receivers, to the equivalent two-way capture.

    The scene itself sends, or what lights it is everywhere at the same time. Each receiver becomes a pose of its own,
    with a transmitter in its place, and the frequencies are halved: 2 pi (f / 2) 2 d / c is the phase of one way d.

    Raises
    ------
    InputError
        There are several transmitters.
    """
    checked_record(capture, Capture, name="capture")
    _check_no_layers(capture)
    poses, transmitters, receivers, samples = capture.frames.shape
    if transmitters != 1:
        raise InputError(f"expected one transmitter in a one-way capture; got {transmitters}")
    radar = capture.radar
    changed = replace(radar, waveform=_scaled(radar.waveform, 0.5), path_offset=2 * radar.path_offset)
    if receivers == 1:
        places = capture.rx_positions
        return replace(
            remade(capture, "set_one_way", {"frequencies_times": 0.5}, radar=changed),
            tx_points=places,
            rx_points=places,
        )
    places = capture.rx_positions.reshape(-1, 1, 3)
    poses = capture.trajectory
    turned = None if poses.orientations is None else np.repeat(poses.orientations, receivers, axis=0)
    array = replace(radar.array, tx_positions=np.zeros((1, 3)), rx_positions=np.zeros((1, 3)))
    return Capture(
        radar=replace(changed, array=array),
        trajectory=Trajectory(times=np.repeat(poses.times, receivers), positions=places[:, 0], orientations=turned),
        frames=capture.frames_of(slice(None)).reshape(-1, 1, 1, samples),
        metadata=with_step(capture.metadata, "set_one_way", frequencies_times=0.5, receivers=receivers),
        tx_points=places,
        rx_points=places,
    )


def see_through(
    capture: Capture,
    layers: Sequence[tuple[float, float]],
    *,
    towards: Sequence[float] = (0.0, 0.0, -1.0),
    permittivity: float = 1.0,
    max_angle: float | None = None,
    reach: tuple[float, float] | None = None,
) -> Capture:
    """Add plane layers in front of the scene, which refract the paths by Snell's law.

    The imagers work out the bent paths: "exact" to rounding, "fast" and "backprojection" by a table that is right to
    some ten-thousandths of a wave. What knows of straight paths alone, as `autofocus` and the sparse imager, finds
    antennas moved along `towards` and a path offset for which straight paths fit best: a ray at the angle a behind the
    layers goes through a layer of thickness t and relative index m, and its path as seen from behind is
    t sqrt(m^2 - sin^2 a) longer (with the sideways part taken off), which b cos a + o comes near, up to `max_angle`.
    The history states what this fit errs by, of both ways together (`path_error`).

    Parameters
    ----------
    layers : (thickness [m], relative permittivity) of each; in any order, since only their sum counts. They lie
        wholly between antennas and scene; where, does not matter
    towards : (3,) from the antennas to the scene, normal to the layers
    permittivity : of what the scene lies in, behind the layers
    max_angle : that rays make with `towards`, in the scene [rad], for the fit; less where the layers reflect all
        beyond. None: as `reach` says, or else 45 degrees
    reach : (across, depth) from antenna to voxel, the longest and the shortest [m]

    Raises
    ------
    InputError
        A number cannot be right, or the capture has layers already.
    """
    checked_record(capture, Capture, name="capture")
    _check_no_layers(capture)
    normal = checked_array(towards, name="towards", shape=(3,))
    if not normal.any():
        raise InputError("towards is 0, 0, 0; expected the direction from the antennas to the scene")
    normal = normal / np.abs(normal).max()  # so that no square of it is beyond all numbers, or 0
    normal = normal / np.linalg.norm(normal)
    index = np.sqrt(checked_number(permittivity, name="permittivity", above=0))
    if not len(layers):
        raise InputError("layers is empty; expected (thickness, permittivity) of each")
    pairs = [checked_numbers(layer, name="a layer", count=2, above=0) for layer in layers]
    thickness, relative = np.array(pairs).T
    relative = np.sqrt(relative) / index
    widest = 0.98 * min(1.0, relative.min())
    if max_angle is not None:
        widest = min(widest, np.sin(min(checked_number(max_angle, name="max_angle", unit="rad", above=0), np.pi / 2)))
    elif reach is None:
        widest = min(widest, np.sqrt(0.5))
    else:
        widest = _widest_sine(widest, thickness, relative, reach)
    sines = np.linspace(0, widest, _RAYS)
    lengths = (thickness * np.sqrt(relative**2 - sines[:, None] ** 2)).sum(axis=1)
    fitted = np.stack([np.sqrt(1 - sines**2), np.ones(_RAYS)], axis=1)
    (straight, offset), *_ = np.linalg.lstsq(fitted, lengths, rcond=None)
    bent = Layers(
        thicknesses=thickness,
        indices=relative,
        normal=normal,
        moved=float(thickness.sum() - straight),
        offset=2 * float(offset),
        error=2 * float(np.abs(fitted @ [straight, offset] - lengths).max()),
    )
    moved = bent.moved * normal
    inside = set_medium(capture, permittivity) if permittivity != 1 else capture
    radar = replace(inside.radar, path_offset=inside.radar.path_offset + bent.offset)
    told = {
        "layers": [list(pair) for pair in pairs], "towards": normal.tolist(), "moved": moved.tolist(),
        "path_offset": bent.offset, "max_angle": float(np.arcsin(sines[-1])), "path_error": bent.error,
    }  # fmt: skip
    shifted = {
        name: points + moved for name in ("tx_points", "rx_points") if (points := getattr(inside, name)) is not None
    }
    poses = replace(inside.trajectory, positions=inside.trajectory.positions + moved)
    metadata = with_step(inside.metadata, "see_through", **told)
    return replace(inside, radar=radar, trajectory=poses, metadata=metadata, layers=bent, **shifted)


def _check_no_layers(capture: Capture) -> None:
    if capture.layers is not None:
        raise InputError(
            "the capture already has layers; apply this step before they are added, and add all layers at once"
        )


def _widest_sine(limit: float, thickness: np.ndarray, relative: np.ndarray, reach: tuple[float, float]) -> float:
    """The sine, behind the layers, of the ray that goes `reach` across and deep, by Snell's law; `limit` at most."""
    across, depth = checked_numbers(reach, name="reach", count=2, minimum=0)
    behind = max(depth - thickness.sum(), 0.0)
    sines = np.linspace(0, limit, 4 * _RAYS)[:, None]
    ways = behind * (sines / np.sqrt(1 - sines**2))[:, 0] + (thickness * sines / np.sqrt(relative**2 - sines**2)).sum(
        axis=1
    )
    return float(np.interp(across, ways, sines[:, 0]))


def _scaled(waveform: Waveform, factor: float) -> Waveform:
    return replace(waveform, start_frequency=factor * waveform.start_frequency, slope=factor * waveform.slope)
