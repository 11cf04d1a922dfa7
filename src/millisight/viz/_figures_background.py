"""The paper's two background figures, computed where they can be: how an aperture makes an image, and reflections."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.patches import Arc

from millisight.core import SPEED_OF_LIGHT, checked_number
from millisight.data import PHASE_SIGN
from millisight.viz._figures import BLUE, GREY, VERMILION, taken_axes
from millisight.viz._panels import Scale, checked_colormap, show_pixels, styled

_REFLECTORS = np.array([[-0.06, 0.0, -0.30], [0.05, 0.0, -0.25], [0.02, 0.0, -0.36]])  # in the plane y = 0 [m]
_FREQUENCIES = np.linspace(77.5e9, 80.5e9, 16)  # [Hz]
_STEP = 0.00097  # a quarter wavelength [m]
_ROUGHNESS = 0.04  # height of the surface's bumps, in the drawing's unit


@styled
def plot_aperture_principle(
    *, aperture: float = 0.2, colormap: str | Colormap | None = None, axes: Sequence[Axes] | np.ndarray | None = None
) -> np.ndarray:
    """How positions become an image (the paper's Fig. "mmWave Imaging"), computed by primer (4) for three reflectors.

    a) each position measures distances, so a reflector lies where the arcs meet; b) the image of a single position:
    rings; c) that of all positions: points. The images are exact, in the plane of the aperture's line, at 77.5 to
    80.5 GHz.

    Parameters
    ----------
    aperture : length of the line of positions, a quarter wavelength apart [m]
    colormap : as for `plot_image`
    axes : (3,) which are returned; default those of a new figure, in a row

    Raises
    ------
    InputError
    """
    aperture = checked_number(aperture, name="aperture", unit="m", above=_STEP)
    colours, shades = checked_colormap(colormap), Scale.checked("linear", 30)
    sketch, one, all_ = taken_axes(axes, 1, 3, size=3.0, tall=0.93)
    line = np.arange(-aperture / 2, aperture / 2 + _STEP / 2, _STEP)
    positions = np.column_stack([line, np.zeros_like(line), np.zeros_like(line)])
    x, z = np.linspace(-0.13, 0.13, 105), np.linspace(-0.42, -0.18, 97)
    _sketch_aperture(sketch, positions)
    middle = positions[[len(positions) // 2]]
    panels = ((one, middle, "b) image of one position"), (all_, positions, f"c) image of {len(positions)} positions"))
    for place, poses, title in panels:
        place.set(xlim=(x[0], x[-1]), ylim=(z[0], z[-1]))
        show_pixels(place, x, z, shades(_image(poses, x, z)), shades, colours)
        place.plot(_REFLECTORS[:, 0], _REFLECTORS[:, 2], "o", mfc="none", mec="white", ms=9, mew=0.7)
        place.set(title=title, xlabel="x [m]", ylabel="z [m]")
    return np.array([sketch, one, all_])


def _image(positions: np.ndarray, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(X, Z) |I| of the reflectors, from where the radar was (P, 3)."""
    from millisight.imaging import image_at

    paths = 2 * np.linalg.norm(positions[:, None] - _REFLECTORS, axis=-1)
    phases = PHASE_SIGN * 2j * np.pi * _FREQUENCIES * paths[..., None] / SPEED_OF_LIGHT  # primer (3)
    frames = np.exp(phases).sum(axis=1)
    points = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    antennas = positions[:, None]
    values = image_at(frames[:, None, None, :], antennas, antennas, _FREQUENCIES, points)
    return np.abs(values).reshape(len(x), len(z))


def _sketch_aperture(ax: Axes, positions: np.ndarray) -> None:
    reflector = _REFLECTORS[0]
    shown = positions[np.linspace(0, len(positions) - 1, 4).astype(int)]
    ax.plot(positions[:, 0], positions[:, 2], "-", color=GREY, lw=4, alpha=0.35, solid_capstyle="butt")
    for place in shown:
        reach = np.hypot(*(place - reflector)[[0, 2]])
        towards = np.degrees(np.arctan2(reflector[2] - place[2], reflector[0] - place[0]))
        angles = {"theta1": towards - 24, "theta2": towards + 24}
        ax.add_patch(Arc((place[0], place[2]), 2 * reach, 2 * reach, **angles, color=BLUE, lw=1))
        ax.plot(*zip(place[[0, 2]], reflector[[0, 2]], strict=True), color=BLUE, lw=0.6, ls=":")
    ax.plot(shown[:, 0], shown[:, 2], "s", color=BLUE, ms=5)
    ax.plot(*reflector[[0, 2]], "o", color=VERMILION, ms=7)
    ax.annotate("aperture", (0, 0), (0, 7), textcoords="offset points", ha="center", color=GREY)
    ax.annotate("reflector", reflector[[0, 2]], (-3, -15), textcoords="offset points", ha="right", color=VERMILION)
    ax.set(xlim=(-0.24, 0.24), ylim=(-0.42, 0.06), aspect="equal", facecolor="white")
    ax.set(title="a) distances from four positions", xlabel="x [m]", ylabel="z [m]")


@styled
def plot_reflection_principle(*, axes: Sequence[Axes] | np.ndarray | None = None) -> np.ndarray:
    """Why surfaces look different to a radar (the paper's Fig. "Diffuse and Specular Reflections").

    One rough surface scatters light to all sides and mirrors millimetre waves, for which its bumps are small; an edge
    scatters the waves that meet it. A surface counts as smooth while its bumps are lower than about an eighth of the
    wavelength over the cosine of the angle of incidence (the Rayleigh criterion).

    Parameters
    ----------
    axes : (3,) which are returned; default those of a new figure, in a row

    Raises
    ------
    InputError
    """
    light, waves, edge = taken_axes(axes, 1, 3, size=2.7, tall=0.72)
    x = np.linspace(-1.5, 1.5, 400)
    rough = _ROUGHNESS * sum(np.sin(k * x + 1.7 * k) / n for n, k in enumerate((9, 23, 41, 67), start=1))
    for place, title in ((light, "a) light: diffuse"), (waves, "b) millimetre waves: specular")):
        place.fill_between(x, rough, -0.5, color="#d9dde0", linewidth=0)
        place.plot(x, rough, color=GREY, lw=1.2)
        place.set_title(title)
    for angle in np.radians([15, 32, 49, 66, 83, 100, 117, 154, 168]):  # not along the wave that comes in
        _arrow(light, (0, 0.06), (0.95 * np.cos(angle), 0.06 + 0.95 * np.sin(angle)), BLUE, 1.0)
    _arrow(light, (-1.15, 1.15), (-0.02, 0.06), BLUE, 2.2)
    _arrow(waves, (-1.15, 1.15), (-0.02, 0.06), VERMILION, 2.2)
    _arrow(waves, (0.02, 0.06), (1.15, 1.15), VERMILION, 2.2)
    waves.plot([0, 0], [0.06, 1.15], color=GREY, lw=0.8, ls="--")
    waves.annotate("n", (0, 1.16), ha="center", color=GREY)
    _note(light, "λ ≈ 0.5 µm, far under the bumps")
    _note(waves, "λ ≈ 4 mm, far over the bumps")
    edge.fill([-1.5, 0, 0, -1.5], [0, 0, -0.5, -0.5], color="#d9dde0", linewidth=0)
    edge.plot([-1.5, 0, 0], [0, 0, -0.5], color=GREY, lw=1.2)
    _arrow(edge, (-1.15, 1.15), (-0.02, 0.02), VERMILION, 2.2)
    for angle in np.radians([-70, -45, -20, 5, 30, 55, 80, 105, 160]):
        _arrow(edge, (0, 0), (0.75 * np.cos(angle), 0.75 * np.sin(angle)), VERMILION, 1.0)
    edge.set_title("c) at an edge: to all sides")
    for place in (light, waves, edge):
        place.set(xlim=(-1.5, 1.5), ylim=(-0.75, 1.35), aspect="equal", xticks=[], yticks=[], facecolor="white")
        place.spines[:].set_visible(False)
    return np.array([light, waves, edge])


def _arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float], color: str, width: float) -> None:
    look = {"arrowstyle": "-|>", "mutation_scale": 9, "color": color, "lw": width, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", end, start, arrowprops=look)


def _note(ax: Axes, text: str) -> None:
    ax.text(0, -0.62, text, ha="center", va="center", color=GREY, fontsize=8)
