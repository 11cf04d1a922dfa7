"""What a radar receives of surfaces: physical optics, with edges, double bounces, and sheets in between.

**Units.** An echo is the field at the receiver of a transmitter whose own field is exp(-i k r) / r, so [1/m]; a target
of radar cross-section σ gives sqrt(σ / 4 π) / (r_t r_r). Times sqrt(G_t G_r) λ / (4 π), with the gains in front of the
antennas, it is the received over the transmitted wave, and its square the radar equation.

**The sum.** Kirchhoff's integral over what both antennas see, in scalars (Ulaby, Moore & Fung, "Microwave Remote
Sensing" II (1982), chapter 12; for a conductor in backscatter it is the vector form of physical optics):

    S = i / λ  sum over patches  Γ(θ) (cos θ_t + cos θ_r) / 2  F  A / (r_t r_r)  exp(-i k (r_t + r_r)),

with A the patch's area, F the mean of the phase over it, and Γ the reflection (`surface`) at the mean angle θ. It is
symmetric in transmitter and receiver. Roughness takes power from Γ, of which

    sqrt(A / π) ξ cos θ' sqrt(ρ(θ')) / (r_t r_r) exp(-i k (r_t + r_r))

comes back, with a complex normal number ξ of each patch and θ' the larger of both angles: in backscatter, on average,
Lambert's law with the albedo ρ = |Γ_smooth|² - |Γ|²; in other directions less, so that no power is created.

F, ξ and the form of sheets and antennas are those of the band's centre; all amplitudes then grow with f / f_c, as
1 / λ does. What is not there: two polarisations, waves in and through objects, creeping waves, and more bounces.
"""

from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from millisight.core import (
    checked_integer,
    checked_items,
    checked_number,
    checked_record,
    put,
    record,
    rotation_from_quaternion,
)
from millisight.core.errors import InputError
from millisight.data import Material, Radar, Trajectory, TriangleMesh
from millisight.rig.virtual._nodes import Nodes
from millisight.rig.virtual._occluders import Sheet
from millisight.rig.virtual._scatterers import Pairs, SurfaceScatterers
from millisight.rig.virtual._settings import Antenna
from millisight.rig.virtual._shadows import Cell, ShadowCells
from millisight.rig.virtual._surface import Boundary, permittivity_at

# In one go: scatterers times antennas, a byte each for what is seen; and poses, some 100 kB each for their bins.
_LIGHT, _POSES = 24_000_000, 1000


@record
class Part:
    """A piece of one material that the radar looks at.

    Attributes
    ----------
    mesh : in the world frame [m], wound outwards; what faces away returns nothing
    material : a Material, or a complex relative permittivity ε' - i ε''
    wall : thickness of a hollow thing's wall, with air inside [m]; None: solid, or too lossy for its back to matter
    roughness : rms height [m]; None: the material's, 0 for a number
    """

    mesh: TriangleMesh
    material: Any
    wall: float | None = None
    roughness: float | None = None

    def __post_init__(self) -> None:
        checked_record(self.mesh, TriangleMesh, name="mesh")
        if self.wall is not None:
            put(self, wall=checked_number(self.wall, name="wall", unit="m", above=0))
        if self.roughness is None:
            put(self, roughness=self.material.roughness if isinstance(self.material, Material) else 0.0)

    def surface(self, frequency: float) -> Boundary:
        """What the wave meets, at `frequency` [Hz]."""
        permittivity, rough = permittivity_at(self.material, frequency), float(self.roughness or 0.0)
        if self.wall is None:
            return Boundary(backing=permittivity, roughness=rough)
        return Boundary(backing=1.0, layers=((permittivity, self.wall),), roughness=rough)


class EchoModel:
    """Parts and sheets made ready for one radar, to be asked for frames again and again, row by row of a scan.

    Parameters
    ----------
    parts : what casts shadows and reflects; may be empty
    radar : what measures
    plan : about where it will measure from: tells which antennas share their views
    edges : whether sharp edges diffract (`edges`)
    bounces : 1, or 2 with double reflections (`multipath`)
    occluders : sheets, which let through, delay and reflect, but cast no shadow
    antenna : pattern; None: none
    rng : seed or generator of the rough parts' random phases; needed only where something is rough

    Raises
    ------
    InputError
        An argument cannot be right, or something is rough and `rng` is missing.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        radar: Radar,
        plan: Trajectory,
        *,
        edges: bool = True,
        bounces: int = 2,
        occluders: Sequence[Sheet] = (),
        antenna: Antenna | None = None,
        rng: int | np.random.Generator | None = None,
    ):
        parts = checked_items(parts, Part, name="a part")
        sheets = checked_items(occluders, Sheet, name="an occluder")
        self._radar = checked_record(radar, Radar, name="radar")
        checked_record(plan, Trajectory, name="the trajectory")
        if checked_integer(bounces, name="bounces") > 2:
            raise InputError(f"bounces is {bounces}; expected 1 or 2")
        self._bounces = bounces == 2
        self._pairs: dict[Cell, Pairs] = {}
        self._scatterers: SurfaceScatterers | None = None
        if parts or sheets:
            solids = [(part.mesh, part.surface(radar.waveform.center_frequency)) for part in parts]
            self._scatterers = SurfaceScatterers(solids, sheets, radar, edges=edges, antenna=antenna, rng=rng)
            antennas = self._antennas(plan)
            self._nodes = Nodes.of(radar.array, float(self._scatterers.distances(antennas.reshape(-1, 3)).min()))
            self._shadows = ShadowCells(
                self._scatterers.shade, self._scatterers.places, self._scatterers.directions, antennas
            )

    def frames(self, trajectory: Trajectory, *, progress: Callable[[int, int], None] | None = None) -> np.ndarray:
        """(P, T, R, N) complex64 in the units of this module [1/m] and with primer (3)'s sign, path offset and all.

        `progress` is called with (poses done, poses in all).

        Raises
        ------
        CoverageError
            An antenna is on a surface, or nearly so.
        """
        array, poses = self._radar.array, len(trajectory)
        shape = (poses, len(array.tx_positions), len(array.rx_positions), self._radar.waveform.samples_per_chirp)
        frames = np.zeros(shape, dtype=np.complex64)
        if self._scatterers is None:
            return frames
        antennas, axes = self._antennas(trajectory), _axes(trajectory)
        self._scatterers.check_clearance(antennas.reshape(-1, 3))
        nodes = self._nodes
        eyes = np.concatenate([np.arange(nodes.transmitters), nodes.transmitters + nodes.receivers])
        step = min(_POSES, max(1, _LIGHT // (len(eyes) * len(self._scatterers.places))))
        order, cells = self._shadows.cells_of(antennas)
        for start in range(0, poses, step):
            some = order[start : start + step]
            light = self._shadows.light(antennas[some][:, eyes].reshape(-1, 3))
            mirrors = self._mirrors(cells[start : start + step]) if self._bounces else []
            frames[some] = self._scatterers.frames(antennas[some], axes[some], nodes, light, mirrors)
            if progress is not None:
                progress(start + len(some), poses)
        return frames

    def _antennas(self, trajectory: Trajectory) -> np.ndarray:
        """(P, T + R, 3) transmitters, then receivers [m]."""
        array = self._radar.array
        return np.concatenate([trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)], axis=1)

    def _mirrors(self, cells: list[Cell]) -> list[tuple[int, Pairs]]:
        """For runs of equal cells: how many, and the double bounces seen from there; kept, since rows come back."""
        runs = []
        for cell, run in groupby(cells):
            if cell not in self._pairs and self._scatterers is not None:
                self._pairs[cell] = self._scatterers.bounces_from(
                    self._shadows.center(cell), self._shadows.seen_about(cell)
                )
            runs.append((len(list(run)), self._pairs[cell]))
        return runs


def echoes(
    parts: Sequence[Part],
    radar: Radar,
    trajectory: Trajectory,
    *,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> np.ndarray:
    """(P, T, R, N) complex64 frames of parts and sheets, of which an `EchoModel` with these settings is made and asked.

    Examples
    --------
    >>> from millisight.meshes import build_object
    >>> cube = Part(mesh=build_object("rubiks_cube"), material=2.7 - 0.02j)
    >>> path = Trajectory.raster(size=(0.02, 0.02), step=0.01, center=(0, 0, 0.25))
    >>> echoes([cube], Radar.preset("position2go"), path, bounces=1).shape
    (9, 1, 2, 256)
    """
    return EchoModel(parts, radar, trajectory, **settings).frames(trajectory, progress=progress)


def _axes(trajectory: Trajectory) -> np.ndarray:
    """(P, 3, 3) the radar's x, y, and the direction it looks in, -z, as rows in the world frame."""
    turn = np.broadcast_to(np.eye(3), (len(trajectory), 3, 3))
    if trajectory.orientations is not None:
        turn = rotation_from_quaternion(trajectory.orientations)
    return np.swapaxes(turn, 1, 2) * np.array([1.0, 1.0, -1.0])[:, None]
