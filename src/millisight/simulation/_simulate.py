"""The paper's simulator: frames of a radar that looks at a mesh (primer 13)."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, check_device, check_known, checked_record, with_step
from millisight.core.errors import CoverageError
from millisight.data import PHASE_SIGN, Capture, Radar, Scene, Trajectory
from millisight.simulation._models import ScatteringModel, of_channels, parameters_of, scattering_model
from millisight.simulation._noise import add_noise, check_noise
from millisight.simulation._scatterers import Scatterers

SPREADINGS = ("none", "1/d")


def simulate(
    scene: Scene,
    radar: Radar,
    trajectory: Trajectory,
    *,
    model: Literal["specular", "edge", "diffuse", "rough"] | str | ScatteringModel = "specular",
    spreading: Literal["none", "1/d"] | str = "none",
    snr_db: float | None = None,
    rng: int | np.random.Generator | None = None,
    device: Literal["cpu", "cuda"] | str = "cpu",
    progress: Callable[[int, int], None] | None = None,
    **parameters: Any,
) -> Capture:
    """Simulate a radar capture of a scene: every lit vertex is a point reflector (paper Eq. 4 to 7, primer 13).

    Parameters
    ----------
    scene : objects in the world frame
    radar, trajectory : radar and its poses
    model : "specular", "edge", "diffuse" or "rough", a name of `SCATTERING_MODELS`, or a ScatteringModel of your own
    spreading : "none" as in the paper, or "1/d", the amplitude decreases with the round-trip path length
    snr_db : add complex white noise: mean |S|² of the capture over the noise's variance [dB] (primer 15)
    rng : seed or generator of the noise; the seed is stored in the metadata
    device : "cpu", or "cuda" for the sum of signals where there is a GPU; rays are cast on the CPU
    progress : called with (poses done, poses in all)
    **parameters : of the model: `tau_deg` and `two_sided` of "specular", `edge_deg` of "edge", `lobe_deg` of "rough";
        the first three are accepted with every model name, but used only by their own model

    Returns
    -------
    Capture
        Frames with the sign of primer (3). In its metadata, `lit_fraction` is the share of vertices that reflect to at
        least one position (0: the capture is empty) and `scene_bounds` the scene's bounding box [m].

    Raises
    ------
    InputError, UnknownNameError
        An argument is invalid. CoverageError
        An antenna lies on or inside the scene's bounding box.

    Examples
    --------
    >>> scene = Scene.from_mesh("rubiks_cube", vertices=400)
    >>> radar = Radar.preset("mito-sim-24ghz")
    >>> capture = simulate(scene, radar, Trajectory.raster(size=(0.04, 0.04), step=0.01))
    >>> capture.frames.shape
    (25, 1, 1, 256)
    """
    checked_record(scene, Scene, name="scene")
    checked_record(radar, Radar, name="radar")
    checked_record(trajectory, Trajectory, name="trajectory")
    check_spreading(spreading)
    kernels = _kernels_on(device)
    if snr_db is not None:
        check_noise(snr_db, rng)
    scattering = scattering_model(model, **parameters)
    done, tell = 0, progress or (lambda done, total: None)
    scatterers = Scatterers(scene.mesh, scattering, each=lambda: tell(done, len(trajectory)))
    array = radar.array
    tx, rx = trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)
    _check_clearance(scene, tx, rx)

    poses, samples = len(trajectory), radar.waveform.samples_per_chirp
    frames = np.zeros((poses, len(array.tx_positions), len(array.rx_positions), samples), dtype=np.complex64)
    reflections = scene.reflections
    band = _band_over(scatterers.points, radar)
    ever_lit = np.zeros(len(scene.mesh.vertices), dtype=bool)
    for block, some in scatterers.blocks(tx, rx):
        if len(some.indices):
            weights = some.weights(tx[block], rx[block])
            ever_lit[some.indices] |= weights.any(axis=(0, 1, 2))
            _add_signals(
                kernels, weights, tx[block], rx[block], some.points, reflections[some.indices], radar, spreading, block,
                frames, band=band,
            )  # fmt: skip
        done += len(block)
        tell(done, poses)

    settings = {
        "model": scattering.name,
        **{name: getattr(scattering, name) for name in parameters_of(scattering)},
        "spreading": spreading,
        "objects": [o.name for o in scene.objects],
        "materials": [o.material.name for o in scene.objects],
    }
    frames.flags.writeable = False
    metadata = {
        "phase_sign": PHASE_SIGN,
        "simulated": True,
        "lit_fraction": float(ever_lit.mean()),
        "scene_bounds": scene.mesh.bounds.tolist(),
    }
    capture = Capture(
        radar=radar, trajectory=trajectory, frames=frames, metadata=with_step(metadata, "simulate", **settings)
    )
    return capture if snr_db is None else add_noise(capture, snr_db=snr_db, rng=rng)


def check_spreading(name: str) -> None:
    """Refuse a spreading law that is not known, before any work; `UnknownNameError`."""
    check_known("spreading law", name, SPREADINGS)


def _kernels_on(device: str) -> Any:
    """The sums for a device: `_kernels` or `_cuda`, with the same names."""
    check_device(device)
    if device == "cuda":
        from millisight.simulation import _cuda as kernels
    else:
        from millisight.simulation import _kernels as kernels
    return kernels


class _Band(NamedTuple):
    """Where in the band signals are summed: see `_band_over`.

    Attributes
    ----------
    center : (3,) the middle of the points [m]
    frequencies : (N / 2,) of the samples above the band's middle, less the middle, over c, the highest first [1/m]
    nodes : (n,) on [0, 1] of the half band
    interpolation : (2, n, N / 2) float32, of the even and of the odd part
    """

    center: np.ndarray
    frequencies: np.ndarray
    nodes: np.ndarray
    interpolation: np.ndarray


def _band_over(points: np.ndarray, radar: Radar) -> _Band | None:
    """The nodes that signals of these points need; None without points.

    Less the common delay of the scene's centre, the signal varies slowly with frequency: it is summed at a few
    Chebyshev nodes of the band, from which a matrix product gives every sample: see `_band_nodes`. Samples and nodes
    are even about the band's middle, so that even and odd parts of the signal need half of each.
    """
    if not len(points):
        return None
    waveform = radar.waveform
    lower, upper = points.min(axis=0), points.max(axis=0)
    frequencies = (waveform.frequencies - waveform.center_frequency) / SPEED_OF_LIGHT
    # A path differs from the centre's by at most 2 radii, and a frequency by half the band.
    phase = 2 * np.pi * abs(frequencies[-1]) * float(np.linalg.norm(upper - lower))
    nodes, matrix = _band_nodes(frequencies, phase)
    samples, some = (len(frequencies) + 1) // 2, (len(nodes) + 1) // 2
    upper_half, mirrored = matrix[:some, ::-1][:, :samples], matrix[::-1, ::-1][:some, :samples]
    even, odd = upper_half + mirrored, upper_half - mirrored
    if len(nodes) % 2:
        even[-1] /= 2  # the middle one meets itself
    interpolation = np.stack([even, odd]).astype(np.float32)
    return _Band((lower + upper) / 2, frequencies[::-1][:samples].copy(), nodes[:some].copy(), interpolation)


def _add_signals(
    kernels, weights, tx, rx, points, reflections, radar, spreading, block, frames, *, band: _Band | None = None
) -> None:
    """Write the frames of the poses `block`: the weighted sum over vertices (primer 13)."""
    band = band or _band_over(points, radar)
    if band is None:
        return
    tx, rx = of_channels(tx, rx)
    signals = np.empty((len(tx), 2, len(band.nodes)), dtype=np.complex64)
    weights = np.ascontiguousarray(weights.reshape(len(tx), -1))  # a model of one's own may order them otherwise
    kernels.node_signals(
        weights, tx, rx, points, reflections, spreading == "1/d", band.center, radar.path_offset,
        radar.waveform.center_frequency / SPEED_OF_LIGHT, band.frequencies[0], band.nodes, signals,
    )  # fmt: skip
    channels = frames.shape[1] * frames.shape[2]
    rows = (np.asarray(block)[:, None] * channels + np.arange(channels)).ravel()
    kernels.write_frames(
        signals, band.interpolation, tx, rx, band.center, radar.path_offset, band.frequencies, rows,
        frames.reshape(-1, frames.shape[-1]),
    )  # fmt: skip


def _band_nodes(frequencies: np.ndarray, phase: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n,) on [-1, 1] of the band, falling, and the (n, N) matrix that gives the samples from them.

    exp(i phase x) is held to 1e-7 by so many Chebyshev nodes: its coefficients are the Bessel functions J_n(phase),
    which vanish faster than exponentially once n exceeds the phase by a few times its cube root. Where the samples
    themselves are fewer, they are the nodes.
    """
    half_band = frequencies[-1]
    places = frequencies / half_band if half_band else frequencies
    count = int(np.ceil(phase + 5 * np.cbrt(phase) + 8))
    if count >= len(frequencies):
        return places[::-1], np.eye(len(frequencies))[::-1]
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    vandermonde = np.polynomial.chebyshev.chebvander
    matrix = vandermonde(places, count - 1) @ np.linalg.inv(vandermonde(nodes, count - 1))
    return nodes, matrix.T


def _check_clearance(scene: Scene, *antennas: np.ndarray) -> None:
    lower, upper = scene.mesh.bounds
    for positions in antennas:
        inside = ((positions >= lower) & (positions <= upper)).all(axis=-1)
        if inside.any():
            where = positions[inside][0]
            raise CoverageError(
                f"{int(inside.sum())} antenna positions, such as {np.round(where, 3).tolist()} m, lie inside the "
                f"object's bounding box {np.round(lower, 3).tolist()} to {np.round(upper, 3).tolist()} m; "
                "raise the aperture or check the mesh's unit"
            )
