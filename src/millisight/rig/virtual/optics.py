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
from typing import Any

import numpy as np

from millisight.capture.radar import Radar
from millisight.capture.trajectory import Trajectory
from millisight.errors import InputError
from millisight.geometry import rotation_from_quaternion
from millisight.records import checked_integer, checked_number, checked_record, put, record
from millisight.rig.virtual.antenna import Antenna
from millisight.rig.virtual.occluders import Sheet
from millisight.rig.virtual.sight import Sight
from millisight.rig.virtual.surface import Surface, permittivity_at
from millisight.rig.virtual.targets import Targets
from millisight.scene.material import Material
from millisight.scene.mesh import TriangleMesh

# Targets times antennas in one go: a byte each for what is seen.
_LIGHT = 30_000_000


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

    def surface(self, frequency: float) -> Surface:
        """What the wave meets, at `frequency` [Hz]."""
        permittivity, rough = permittivity_at(self.material, frequency), float(self.roughness or 0.0)
        if self.wall is None:
            return Surface(backing=permittivity, roughness=rough)
        return Surface(backing=1.0, layers=((permittivity, self.wall),), roughness=rough)


def echoes(
    parts: Sequence[Part],
    radar: Radar,
    trajectory: Trajectory,
    *,
    edges: bool = True,
    bounces: int = 2,
    occluders: Sequence[Sheet] = (),
    antenna: Antenna | None = None,
    rng: int | np.random.Generator | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> np.ndarray:
    """(P, T, R, N) complex64 frames of parts and sheets, in the units of this module [1/m] and with primer (3)'s sign.

    Parameters
    ----------
    parts : what casts shadows and reflects; may be empty
    radar, trajectory : what measures, and from where; the radar's path offset is in
    edges : whether sharp edges diffract (`edges`)
    bounces : 1, or 2 with double reflections (`bounce`)
    occluders : sheets, which let through, delay and reflect, but cast no shadow
    antenna : pattern; None: none
    rng : seed or generator of the rough parts' random phases; needed only where something is rough
    progress : called with (poses done, poses in all)

    Raises
    ------
    InputError
        An argument cannot be right, or something is rough and `rng` is missing.
    CoverageError
        An antenna is on a surface, or nearly so.
    """
    parts = tuple(checked_record(part, Part, name="a part") for part in parts)
    occluders = tuple(checked_record(sheet, Sheet, name="an occluder") for sheet in occluders)
    checked_record(radar, Radar, name="radar")
    checked_record(trajectory, Trajectory, name="trajectory")
    if checked_integer(bounces, name="bounces") > 2:
        raise InputError(f"bounces is {bounces}; expected 1 or 2")
    poses, waveform = len(trajectory), radar.waveform
    shape = (poses, len(radar.array.tx_positions), len(radar.array.rx_positions), waveform.samples_per_chirp)
    frames = np.zeros(shape, dtype=np.complex64)
    if not parts and not occluders:
        return frames
    solids = [(part.mesh, part.surface(waveform.center_frequency)) for part in parts]
    targets = Targets(solids, occluders, radar, edges=edges, antenna=antenna, rng=rng)
    placed = [trajectory.placed(radar.array.tx_positions), trajectory.placed(radar.array.rx_positions)]
    antennas, axes = np.concatenate(placed, axis=1), _axes(trajectory)
    targets.check_clearance(antennas.reshape(-1, 3))
    sight = Sight(targets.rays, targets.places, targets.directions, antennas)
    step = max(1, _LIGHT // (antennas.shape[1] * len(targets.places)))
    done = 0
    for block in sight.blocks():
        pairs = targets.bounces_from(antennas[block].mean(axis=(0, 1))) if bounces == 2 else None
        for start in range(0, len(block), step):
            some = block[start : start + step]
            light = sight.light(antennas[some].reshape(-1, 3))
            frames[some] = targets.frames(antennas[some], axes[some], light, pairs)
            done += len(some)
            if progress is not None:
                progress(done, poses)
    return frames


def _axes(trajectory: Trajectory) -> np.ndarray:
    """(P, 3, 3) the radar's x, y, and the direction it looks in, -z, as rows in the world frame."""
    turn = np.broadcast_to(np.eye(3), (len(trajectory), 3, 3))
    if trajectory.orientations is not None:
        turn = rotation_from_quaternion(trajectory.orientations)
    return np.swapaxes(turn, 1, 2) * np.array([1.0, 1.0, -1.0])[:, None]
