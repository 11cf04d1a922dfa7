"""An image that grows while a scan is taken: images of its parts, added up."""

import numpy as np

from millisight.core import checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import Capture, Radar, SarImage, VoxelGrid
from millisight.imaging._form import TOLERANCE, form_image
from millisight.imaging._sides import antennas_of
from millisight.imaging._windows import window_pair


class GrowingImage:
    """An image of all that was added so far; at the end that of the whole scan.

    The image is a mean over antenna positions and channels (paper Eq. 1), so images of parts of a scan, weighted by
    their channels, add up to that of the whole. Each part errs by the tolerance at most. Apertures of separate parts
    have separate spectra, so energies add up, of the image as of the errors, and the sum keeps the relative error.

    Parameters
    ----------
    grid : voxels of the image, in the world frame
    window : None, "hann" or "taylor" over range. There is none over the aperture, whose extent is not known yet
    tolerance : as for `form_image`

    Raises
    ------
    InputError, UnknownNameError
        An argument is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from millisight.data import Radar, Scene, Trajectory
    >>> from millisight.simulation import simulate
    >>> radar, scene = Radar.preset("mito-sim-24ghz"), Scene.from_mesh("golf_ball", vertices=300)
    >>> rows = [Trajectory.raster(size=(0.1, 0.0), step=0.01, center=(0, y, 0.3)) for y in (-0.01, 0.0, 0.01)]
    >>> growing = GrowingImage(VoxelGrid.regular((-0.05, -0.05, 0), (0.05, 0.05, 0), 0.01))
    >>> for row in rows:
    ...     growing.add(simulate(scene, radar, row))
    >>> growing.poses, growing.image.values.shape
    (33, (11, 11, 1))
    """

    def __init__(self, grid: VoxelGrid, *, window: str | None = None, tolerance: float | None = None):
        self.grid: VoxelGrid = checked_record(grid, VoxelGrid, name="grid")
        self._window, self._tolerance = window_pair((window, None)), tolerance
        self._sum = np.zeros(grid.shape, dtype=np.complex128)
        self._channels = 0
        self._antennas = np.multiply.outer([np.inf, -np.inf], np.ones(3))
        self._radar: Radar | None = None
        self.poses: int = 0
        self.change: float = float("inf")

    def __repr__(self) -> str:
        return f"GrowingImage({self.poses} poses, {' x '.join(map(str, self.grid.shape))} voxels)"

    def add(self, capture: Capture) -> None:
        """Add frames that were not added before.

        `poses` then counts theirs, too, and `change` says by how much the image differs from the one before, relative
        to its own norm: it falls as the scan goes on.

        Raises
        ------
        InputError
            The capture is of another radar than those before, or NaN is in it; nothing is added.
        """
        checked_record(capture, Capture, name="capture")
        before, radar = self._radar, capture.radar
        if before is not None and not np.array_equal(before.waveform.frequencies, radar.waveform.frequencies):
            raise InputError(f"the capture is of {radar.name}, those before of {before.name}; expected one radar")
        part = form_image(capture, self.grid, window=self._window, tolerance=self._tolerance)
        old = self._sum / max(self._channels, 1)
        self._sum += capture.channels * part.values.astype(np.complex128)
        self._radar, self._channels = radar, self._channels + capture.channels
        (lower, upper), (low, high) = self._antennas, antennas_of(capture)
        self._antennas = np.stack([np.minimum(lower, low), np.maximum(upper, high)])
        self.poses += len(capture.trajectory)
        new = self._sum / self._channels
        size = float(np.linalg.norm(new))
        self.change = float(np.linalg.norm(new - old)) / size if size > 0 else float("inf")

    @property
    def image(self) -> SarImage:
        """The image so far.

        Raises
        ------
        InputError
            Nothing was added yet.
        """
        if self._radar is None:
            raise InputError("nothing was added yet; expected at least one capture")
        metadata = with_step(
            {"poses": self.poses},
            "form_image",
            method="fast",
            window=list(self._window),
            frequency=float(self._radar.waveform.center_frequency),
            tolerance=TOLERANCE if self._tolerance is None else self._tolerance,
            antennas=self._antennas.tolist(),
        )
        return SarImage(grid=self.grid, values=(self._sum / self._channels).astype(np.complex64), metadata=metadata)
