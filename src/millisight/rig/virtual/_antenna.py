"""The pattern of a radar's antennas."""

import numpy as np

from millisight.core import checked_number, put, record
from millisight.core.errors import InputError


@record
class Antenna:
    """An antenna that looks along -z of the radar frame; transmitters and receivers have the same.

    Attributes
    ----------
    beamwidth_x_deg, beamwidth_y_deg : full width at half power in the planes of z with x and with y [degrees]

    Its power pattern is cos^p α_x cos^q α_y, with α_x and α_y the angles off -z as seen along y and along x, so a
    power of a cosine in either plane (Balanis, "Antenna Theory" (2016), section 2.5, has such patterns), nothing
    behind, and 1 in front.
    """

    beamwidth_x_deg: float
    beamwidth_y_deg: float

    def __post_init__(self) -> None:
        for name in ("beamwidth_x_deg", "beamwidth_y_deg"):
            width = checked_number(getattr(self, name), name=name, unit="degrees", above=0)
            if width >= 180:
                raise InputError(
                    f"{name} is {width:g} degrees; expected under 180; leave the antenna out for an isotropic one"
                )
            put(self, **{name: width})

    @property
    def exponents(self) -> np.ndarray:
        """(2,) p and q: half the power at half the beamwidth."""
        halves = np.radians([self.beamwidth_x_deg, self.beamwidth_y_deg]) / 2
        return np.log(0.5) / np.log(np.cos(halves))

    def amplitude(self, directions: np.ndarray) -> np.ndarray:
        """(...) of the wave sent along `directions` (..., 3) of any length in the radar frame, 1 in front."""
        ahead = -directions[..., 2]
        power = np.ones(ahead.shape)
        for axis, exponent in enumerate(self.exponents):
            across = np.hypot(ahead, directions[..., axis])
            power *= np.where(ahead > 0, ahead / np.where(across > 0, across, 1.0), 0.0) ** exponent
        return np.sqrt(power)

    @property
    def gain(self) -> float:
        """In front, over an isotropic antenna's, without losses: 4 pi over the integral of the power pattern."""
        nodes, weights = np.polynomial.legendre.leggauss(200)
        cosine = (1 + nodes[:, None]) / 2
        turn = 2 * np.pi * np.arange(200) / 200
        sine = np.sqrt(1 - cosine**2)
        away = np.broadcast_to(-cosine, (200, 200))
        directions = np.stack([sine * np.cos(turn), sine * np.sin(turn), away], axis=-1)
        mean = (weights[:, None] / 2 * self.amplitude(directions) ** 2).sum() / 200
        return float(2 / mean)
