"""All that returns echoes, as the arrays that kernels take, and the frames that it makes for some poses."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, product
from millisight.core.errors import CoverageError, InputError
from millisight.data import Radar, TriangleMesh, Waveform
from millisight.meshes import LIFT, RayCaster
from millisight.rig.virtual import _bounce_kernels as _bounce_kernels
from millisight.rig.virtual import _kernels as _kernels
from millisight.rig.virtual import _path_kernels as _path_kernels
from millisight.rig.virtual._edges import Edges, sharp_edges
from millisight.rig.virtual._multipath import double_bounces
from millisight.rig.virtual._nodes import Nodes
from millisight.rig.virtual._occluders import Sheet, sheet_tables
from millisight.rig.virtual._patches import REACH, Patches, cut, doubled_area, gather
from millisight.rig.virtual._settings import Antenna
from millisight.rig.virtual._surface import Boundary, fitted

if TYPE_CHECKING:
    from scipy.spatial import KDTree

EDGE_DEG = 20.0
"""Edges that turn by more diffract [degrees]; of a finely faceted round body none does."""

# The phase that a bin's series must bear, half a band off the centre: by half a bin, and by a cluster's half diagonal
# on both legs. The sum is 0.9, see _kernels.ORDER.
_BIN_PHASE, _CLUSTER_PHASE = 0.3, 0.6
_MOST_PATCHES = 4e6  # which take some 3 GB
_WIDEST_CLUSTER = 0.03  # over which an antenna's pattern is as good as linear [m]
_LEAST_SLOPE = 1.0  # of a single frequency [rad/m]: bins of 0.6 m

Pairs = tuple[np.ndarray, np.ndarray]
"""(M,) first and (M,) second patches of double bounces."""


class Band(NamedTuple):
    """A radar's band, and how finely it has paths and surfaces divided.

    center, half : of the frequencies, and half their range [Hz]
    carrier : 1 over the wavelength at the centre [1/m]
    slope : half the range as a wave number [rad/m]
    width : of range bins [m]
    cell : of clusters [m]
    """

    center: float
    half: float
    carrier: float
    slope: float
    width: float
    cell: float

    @classmethod
    def of(cls, waveform: Waveform) -> "Band":
        half = float(np.ptp(waveform.frequencies)) / 2
        slope = 2 * np.pi * half / SPEED_OF_LIGHT
        rounded = max(slope, _LEAST_SLOPE)
        cell = min(_WIDEST_CLUSTER, _CLUSTER_PHASE / np.sqrt(3) / rounded)
        center = waveform.center_frequency
        return cls(center, half, center / SPEED_OF_LIGHT, slope, 2 * _BIN_PHASE / rounded, cell)


def _check_area(surfaces: Sequence[np.ndarray], reach: float) -> None:
    """Refuse surfaces, each (F, 3, 3) triangles, that would be cut into too many patches of `reach` [m].

    Raises
    ------
    InputError
    """
    area = sum(float(doubled_area(triangles).sum() / 2) for triangles in surfaces)
    most = _MOST_PATCHES * 0.9 * reach**2  # half a square of side 3 / sqrt(5) times the reach
    if not area <= most:
        raise InputError(
            f"the world's surfaces have {area:.3g} m²; expected at most {most:.3g} m² at this frequency, counting both "
            "faces of a carton and a cloth: make walls, support and covers smaller, as what lies far off hardly echoes"
        )


class SurfaceScatterers:
    """Patches of solids and sheets, and edges of solids; solids cast shadows, sheets none.

    `places` (V, 3) of patches, then edges, lie just above them [m]; `directions` (2, V, 3) are the normals of their
    faces, of which a patch has one, twice; `shade` casts rays at what casts shadows.
    """

    def __init__(
        self,
        solids: Sequence[tuple[TriangleMesh, Boundary]],
        sheets: Sequence[Sheet],
        radar: Radar,
        *,
        edges: bool,
        antenna: Antenna | None,
        rng: int | np.random.Generator | None,
    ):
        from scipy.spatial import KDTree

        band = Band.of(radar.waveform)
        reach = REACH / band.carrier
        faces = [(mesh.vertices[mesh.faces], surface) for mesh, surface in solids]
        faces += [face for sheet in sheets for face in sheet.faces(band.center)]
        surfaces = [surface for _, surface in faces]
        _check_area([triangles for triangles, _ in faces], reach)
        patches = gather([cut(triangles, reach) for triangles, _ in faces], band.cell)
        self._radar, self._band = radar, band
        self._surface, self._starts = patches.surface, patches.starts
        self._corners, self._centroids, self._normals = patches.corners, patches.centroids, patches.normals
        self._areas, self._cluster, self._centers = patches.areas, patches.cluster, patches.centers
        self._table, self._cones = _patch_table(patches, band, _phasors(surfaces, patches, rng)), _cones(patches)
        coherent, self._terms, self._diffuse = fitted(surfaces, band.center, band.half)
        self._coherent = np.stack([np.real(coherent), np.imag(coherent)], axis=2)
        self._sheets, self._sheet_tables = sheet_tables(sheets, band.center, band.half)
        self._own = (patches.surface - len(solids)) // 2  # both faces of a sheet; below 0 for solids
        self._exponents = np.zeros(2) if antenna is None else antenna.exponents

        found = [sharp_edges(mesh, EDGE_DEG, 2 * reach) for mesh, _ in solids] if edges else []
        strengths = [-complex(surface.coherent(band.center, 1.0)) for surface in surfaces]
        self._tree = KDTree(self._centers)
        self._edges, self._edge_cluster = _edge_table(found, strengths, self._centers, self._tree)
        self._edged = np.zeros(len(self._centers), dtype=bool)
        self._edged[self._edge_cluster] = True
        lifted = [edge.middles + LIFT * edge.lift for edge in found]
        self.places = np.concatenate([self._centroids + LIFT * self._normals, *lifted])
        one, other = [edge.normals for edge in found], [edge.others for edge in found]
        self.directions = np.stack([np.concatenate([self._normals, *some]) for some in (one, other)])

        # Patches that cast shadows and mirror; padding does neither.
        self._solid = np.flatnonzero((patches.surface < len(solids))[self._cluster] & (self._areas > 0))
        self._mirrors = self._centroids[self._solid], self._normals[self._solid]
        self._caster = RayCaster(self._corners[self._solid], centered=True)
        # Faces before they were cut: fewer, so that rays cost two thirds.
        whole = [triangles for triangles, _ in faces[: len(solids)]]
        self.shade = RayCaster(np.concatenate(whole) if whole else np.zeros((0, 3, 3)), centered=True)

    def distances(self, antennas: np.ndarray) -> np.ndarray:
        """(A,) from antennas (A, 3) to the middle of the nearest cluster [m]."""
        return np.asarray(self._tree.query(antennas)[0])

    def check_clearance(self, antennas: np.ndarray) -> None:
        """Refuse antennas (A, 3) [m] nearer to a surface than the sums are good for."""
        distance = self.distances(antennas)
        nearest = int(distance.argmin())
        if distance[nearest] < 2 * self._band.cell:
            raise CoverageError(
                f"an antenna at {np.round(antennas[nearest], 3).tolist()} m is {distance[nearest] * 1000:.1f} mm from "
                f"a surface; expected at least {2000 * self._band.cell:.0f} mm: raise the aperture, or lower the object"
            )

    def bounces_from(self, place: np.ndarray, seen: np.ndarray) -> Pairs:
        """Double bounces for antennas about `place` (3,) [m], the shortest paths first, since neighbours then share a
        range bin; the first off those of `places` that are `seen` (V,).
        """
        first, second = double_bounces(place, seen[self._solid], *self._mirrors, self._caster, self.shade)
        first, second = self._solid[first], self._solid[second]
        one, other = self._centroids[first], self._centroids[second]
        legs = one - place, other - one, other - place
        order = np.argsort(sum(np.sqrt(np.einsum("mi,mi->m", leg, leg)) for leg in legs))
        return first[order], second[order]

    def _bounce_tables(self, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, ...]:
        """(4, M), (16, M), (M, 2), (K + 1,) and (K, 2), see `_bounce_kernels.bounce_echoes`."""
        clusters = self._cluster[np.column_stack([first, second])]
        surfaces = self._surface[clusters]
        order = np.lexsort(surfaces.T)
        first, second = first[order], second[order]
        changes = np.flatnonzero((np.diff(surfaces[order], axis=0) != 0).any(axis=1)) + 1
        starts = np.concatenate([[0], changes, [len(first)]]).astype(np.int64)
        places, pairs = np.empty((4, len(first))), np.empty((16, len(first)), dtype=np.float32)
        start = self._centroids[first]
        places[:3], places[3] = start.T, np.einsum("mi,mi->m", start - self._centroids[second], self._normals[second])
        np.take(self._table[:13], first, axis=1, out=pairs[:13], mode="clip")
        np.take(self._table[3:6], second, axis=1, out=pairs[13:], mode="clip")
        return places, pairs, clusters[order], starts, surfaces[order][starts[:-1]]

    def frames(
        self,
        antennas: np.ndarray,
        axes: np.ndarray,
        nodes: Nodes,
        light: np.ndarray,
        mirrors: Sequence[tuple[int, Pairs]],
    ) -> np.ndarray:
        """(P, T, R, N) complex64 frames of `antennas` (P, T + R, 3) [m], whose x, y and -z are `axes` (P, 3, 3).

        `light` (P (T + M), V) is how much of `places` transmitters and nodes see; `mirrors`: for how many poses which
        double bounces.
        """
        poses, count = antennas.shape[:2]
        flat = antennas.reshape(-1, 3)
        legs = np.empty((len(flat), len(self._centers), _kernels.LEG), dtype=np.float32)
        _path_kernels.fill_legs(
            *nodes, flat, axes, self._exponents, self._centers, self._cones, self._edged, self._own, self._sheets,
            self._sheet_tables, legs,
        )  # fmt: skip
        each = nodes.transmitters * len(nodes.between)
        lowest, bins = self._bins(flat, poses * each, far=len(mirrors) > 0)
        scale = self._band.carrier, self._band.slope, lowest, self._band.width
        _kernels.surface_echoes(
            *nodes, flat, light, legs, self._table, self._starts, self._centers, self._cones, self._surface,
            self._coherent, self._terms, self._diffuse, *scale, bins,
        )  # fmt: skip
        if len(self._edges):
            _path_kernels.edge_echoes(
                *nodes, flat, light[:, len(self._centroids) :], legs, self._edges, self._edge_cluster, *scale, bins
            )
        start = 0
        for run, pairs in mirrors:
            of_antennas, of_channels = (slice(start * n, (start + run) * n) for n in (count, each))
            if len(pairs[0]):
                _bounce_kernels.bounce_echoes(
                    *nodes, flat[of_antennas], legs[of_antennas], *self._bounce_tables(*pairs), self._centers,
                    self._coherent, *scale, bins[of_channels],
                )  # fmt: skip
            start += run
        samples = product(bins.reshape(len(bins), -1), self._bin_matrix(lowest, bins.shape[1]))
        return samples.reshape(poses, nodes.transmitters, len(nodes.between), -1)

    def _bins(self, antennas: np.ndarray, channels: int, *, far: bool) -> tuple[int, np.ndarray]:
        """The lowest bin that any path needs, and (C, B, ORDER) empty ones; `far`: for double bounces too."""
        lower, upper = self._centers.min(axis=0), self._centers.max(axis=0)
        aside = np.maximum(np.maximum(lower - antennas, antennas - upper), 0)
        across = np.maximum(abs(lower - antennas), abs(antennas - upper))
        slack = 4 * self._band.cell + 2 * self._band.width
        shortest = 2 * np.linalg.norm(aside, axis=1).min() - slack
        longest = 2 * np.linalg.norm(across, axis=1).max() + slack
        if far:
            longest += 2 * np.linalg.norm(upper - lower)
        lowest = int(np.floor(shortest / self._band.width))
        count = int(np.ceil(longest / self._band.width)) - lowest + 1
        return lowest, np.zeros((channels, count, _kernels.ORDER), dtype=np.complex64)

    def _bin_matrix(self, lowest: int, count: int) -> np.ndarray:
        """(B ORDER, N) samples of each term of each bin: ν^m exp(-i k (D + path_offset)) f / f_c."""
        frequencies = self._radar.waveform.frequencies
        paths = self._band.width * (lowest + np.arange(count)) + self._radar.path_offset
        waves = np.exp(-2j * np.pi / SPEED_OF_LIGHT * np.outer(paths, frequencies)) * frequencies / self._band.center
        nu = (frequencies - self._band.center) / (self._band.half or 1.0)
        matrix = waves[:, None] * nu ** np.arange(_kernels.ORDER)[:, None]
        return matrix.reshape(-1, len(frequencies)).astype(np.complex64)


def _phasors(surfaces: Sequence[Boundary], patches: Patches, rng: int | np.random.Generator | None) -> np.ndarray:
    """(N,) complex normal numbers of mean square 1 for the patches of rough surfaces, 0 for the others."""
    rough = np.array([surface.roughness > 0 for surface in surfaces])[patches.surface][patches.cluster]
    phasors = np.zeros(len(rough), dtype=complex)
    if rough.any():
        if rng is None:
            raise InputError("a part is rough, which needs random phases: pass rng=0, for example")
        draws = np.random.default_rng(rng).standard_normal((int(rough.sum()), 2))
        phasors[rough] = draws @ np.array([1, 1j]) / np.sqrt(2)
    return phasors


def _patch_table(patches: Patches, band: Band, phasors: np.ndarray) -> np.ndarray:
    """(ROWS, N) float32, see `_kernels.ROWS`."""
    centroids, areas = patches.centroids, patches.areas
    random = np.sqrt(areas / np.pi) * phasors
    rows = (
        (centroids - patches.centers[patches.cluster]).T,
        patches.normals.T,
        (patches.corners[:, 0] - centroids).T,
        (patches.corners[:, 1] - centroids).T,
        (areas * band.carrier, np.real(random), np.imag(random)),
    )
    return np.concatenate(rows).astype(np.float32)


def _cones(patches: Patches) -> np.ndarray:
    """(G, 5) see `_kernels.surface_echoes`."""
    away = np.linalg.norm(patches.centroids - patches.centers[patches.cluster], axis=1)
    return np.column_stack([patches.cones, np.maximum.reduceat(away, patches.starts[:-1])])


def _edge_table(
    found: Sequence[Edges], strengths: Sequence[complex], centers: np.ndarray, tree: "KDTree"
) -> tuple[np.ndarray, np.ndarray]:
    """(E, 23) and (E,), see `_path_kernels.edge_echoes`; `tree` is that of the clusters' `centers` (G, 3)."""
    tables, clusters = [np.zeros((0, 23))], [np.zeros(0, dtype=np.int64)]
    for edges, strength in zip(found, strengths, strict=False):
        cluster = np.asarray(tree.query(edges.middles)[1]) if len(edges) else clusters[0]
        n = edges.openings
        strong = np.tile([strength.real, strength.imag], (len(edges), 1))
        columns = (
            edges.middles, edges.along, edges.normals, edges.into, edges.lengths, n, strong,
            edges.middles - centers[cluster], np.cos(np.pi / n), np.sin(np.pi / n) / n, np.cos(n * np.pi),
            np.sin(n * np.pi),
        )  # fmt: skip
        tables.append(np.column_stack(columns))
        clusters.append(cluster)
    return np.concatenate(tables), np.concatenate(clusters)
