"""Figures of objects of known shape where they were found."""

import textwrap

import numpy as np
from matplotlib.figure import Figure

from millisight.core import checked_integer, checked_record
from millisight.data import Located, TriangleMesh
from millisight.viz import _panels
from millisight.viz._figures import VERMILION, draw_mesh
from millisight.viz._outline import PLANE
from millisight.viz._panels import Panel, styled

_MARGIN = 0.2  # around the mesh, of its longest side
_SOLID = "#dfe3e6"
_LETTERS_PER_INCH = 14
_LINE = 0.3  # height of what is told below the title [inches]


@styled
def plot_located(located: Located, mesh: TriangleMesh, *, most_points: int = 400, title: str | None = None) -> Figure:
    """Plot a mesh in the pose that was found, seen along z, y and x, and the points around it; `Located.plot`.

    The panels show the mesh and a fifth of its length around it. Of the points there at most `most_points` are drawn,
    the brightest; a line below the title says how many there are, and how many lie farther off.

    Parameters
    ----------
    located : Located
    mesh : of the first of its poses
    most_points : that are drawn
    title : written above; None: the name of the mesh and the score of its pose

    Raises
    ------
    InputError
    """
    pose = checked_record(located, Located, name="located").poses[0]
    placed = pose.placed(mesh)
    most = checked_integer(most_points, name="most_points", minimum=0)
    margin = _MARGIN * float(placed.extent.max())
    box = placed.bounds + margin * np.array([[-1.0], [1.0]])
    points = located.points.points
    within = np.flatnonzero(((points >= box[0]) & (points <= box[1])).all(axis=1))
    brightest = np.argsort(-np.asarray(located.points.magnitude)[within], kind="stable")[:most]
    drawn = points[within[brightest]]
    named = f"{pose.name}, score {pose.score:.2f}" if title is None else title
    figure, (row,), (bar,) = _panels.place_panels([Panel.views_of(box)], title=named or " ", headroom=_LINE)
    bar.remove()
    for axes, axis in zip(row, PLANE, strict=True):
        axes.set_facecolor("white")
        right, up = PLANE[axis]
        draw_mesh(axes, placed, axis, color=_SOLID)
        axes.plot(drawn[:, right], drawn[:, up], ".", color=VERMILION, markersize=3.5, markeredgewidth=0, zorder=2)
        _panels.draw_outline(axes, placed, axis, color="black")
        _panels.label_view(axes, axis)
    which = "all" if len(drawn) == len(within) else f"the brightest {len(drawn)} of"
    told = f"{which} {len(within)} points around the mesh" if len(within) else "no points around the mesh"
    words = f"outline: the mesh where it was found; dots: {told}; farther off: {len(points) - len(within)}"
    wide, high = figure.get_size_inches()
    words = textwrap.fill(words, int(_LETTERS_PER_INCH * (wide - 1)))
    figure.text(0.72 / wide, 1 - 0.38 / high, words, va="top", color="0.35", linespacing=1.1)
    return figure
