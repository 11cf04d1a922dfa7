"""A surface that was measured: a mesh of what was seen, and how sure it is."""

from dataclasses import field
from typing import Any

import numpy as np

from millisight.core import Metadata, checked_array, checked_metadata, checked_record, late, put, record
from millisight.core.errors import InputError
from millisight.data._mesh import TriangleMesh


@record
class Surface:
    """A mesh of what was seen of an object's surface, open where nothing was seen.

    Attributes
    ----------
    mesh : TriangleMesh, faces counter-clockwise seen from outside
    sigma : (V,) standard deviation of each vertex along the surface's normal [m]
    metadata : provenance; what JSON can hold

    Raises
    ------
    InputError
        There are not as many standard deviations as vertices, or one is below 0.
    """

    mesh: TriangleMesh
    sigma: np.ndarray
    metadata: Metadata = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        count = len(checked_record(self.mesh, TriangleMesh, name="mesh").vertices)
        sigma = checked_array(self.sigma, name="sigma", shape=(count,), unit="m")
        if sigma.min() < 0:
            raise InputError(f"sigma reaches {sigma.min():.3g} m; expected no standard deviation below 0")
        put(self, sigma=sigma, metadata=checked_metadata(self.metadata))

    def __repr__(self) -> str:
        return f"Surface({self.mesh!r}, sigma {1e3 * float(np.median(self.sigma)):.2g} mm in the median)"

    def plot(self, **settings: Any) -> Any:
        """Plot the surface seen along z, y and x, coloured by its standard deviation.

        Parameters
        ----------
        settings : of `millisight.viz.plot_surface`: `points` and the `truth` to draw with it, `worst` (the standard
            deviation at the end of the colours [m]), `colormap`, `title`

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_surface")(self, **settings)
