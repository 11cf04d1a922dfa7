"""One exhibit drawn into a viser scene: under one frame, around the middle of its box."""

from collections.abc import Hashable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.ticker import MaxNLocator

from millisight.core import rotation_from_quaternion
from millisight.viz._panels import grid_box, mask_borders
from millisight.viz.viewer._clip import clipped_segments, cut_mesh, cut_outline, inside
from millisight.viz.viewer._contents import Exhibit
from millisight.viz.viewer._levels import Cloud, Levels, mixed_levels
from millisight.viz.viewer._pick import Picked, pick
from millisight.viz.viewer._settings import ViewSettings

_MOST_SLABS = 32
_MOST_PATH = 6_000  # positions drawn of a path
_MOST_NORMALS = 4_000  # drawn of a mesh
_QUARTER = 0.5**0.5
# Turns of a picture, whose columns run along its x and whose rows along its y, into the plane across each axis.
_ACROSS = ((0.5, 0.5, 0.5, 0.5), (_QUARTER, _QUARTER, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
_BOX, _PATH, _MASK, _PLANE = (140, 148, 158), (74, 163, 223), (0, 229, 160), (110, 118, 128)
_NORMAL, _POSITION = (255, 183, 77), (150, 205, 255)
# In the order of the meshes, and of their outlines in slices, which lie on bright voxels: a surface beside its truth.
_MESHES = (196, 202, 210), (77, 208, 225), (174, 126, 255), (129, 230, 132)
_CUTS = (57, 255, 20), (0, 229, 255), (224, 64, 251), (240, 240, 240)


class Placement(NamedTuple):
    """Where a pane goes: position (3,) [m], turn as quaternion (4,) w x y z; and where its title is in it (3,) [m]."""

    position: np.ndarray
    wxyz: np.ndarray
    title: np.ndarray


class Pane:
    """An exhibit in a viser scene; `show` draws anew what a change of settings changed, and nothing else."""

    def __init__(self, scene: Any, exhibit: Exhibit, name: str, most: int):
        self.exhibit, self.name, self.most = exhibit, name, most
        self.levels, self.offset_db = exhibit.levels, 0.0
        self.cloud: Cloud | None = None
        self._scene, self._share = scene, exhibit.share
        self._drawn: dict[str, Hashable] = {}
        self._nodes: dict[str, list[Any]] = {}
        self._placement: Placement | None = None
        self.middle = exhibit.bounds.mean(axis=0)
        self._frame = scene.add_frame(name, show_axes=False)
        self._title = scene.add_label(
            f"{name}/title", exhibit.title, anchor="bottom-center", font_screen_scale=1.1, position=(0, 0, self.radius)
        )

    @property
    def radius(self) -> float:
        """Of the ball around the pane's middle that holds its image [m]."""
        return float(np.linalg.norm(np.ptp(self.exhibit.bounds, axis=0)) / 2)

    def place(self, placement: Placement) -> None:
        """Put the pane where the camera's place demands it."""
        self._placement = placement
        self._frame.position, self._frame.wxyz = placement.position, placement.wxyz
        self._title.position = placement.title

    def pick(self, origin: np.ndarray, direction: np.ndarray, settings: ViewSettings) -> Picked | None:
        """What a ray in the scene meets first of the image, its level in dB as the pane shows it."""
        if self.levels is None or self._placement is None:
            return None
        turn = rotation_from_quaternion(np.roll(self._placement.wxyz, -1))  # pane to scene
        start = turn.T @ (origin - self._placement.position) + self.middle
        met = pick(self.levels, settings, settings.threshold_db - self.offset_db, start, turn.T @ direction)
        return None if met is None else met._replace(db=met.db + self.offset_db)

    def weigh(self, settings: ViewSettings) -> None:
        """Weigh specular and edge image anew, where there are two; take the image with or without its lid."""
        if self.exhibit.pair is not None and settings.share != self._share:
            self.levels, self._share = mixed_levels(*self.exhibit.pair, settings.share), settings.share
        cover = self.exhibit.cover
        if cover is not None and cover.levels is not None:
            self.levels = self.exhibit.levels if settings.clutter else cover.levels

    def show(self, settings: ViewSettings, offset_db: float) -> None:
        """Draw what `settings` ask for; levels lie `offset_db` under the maximum that dB count from."""
        self.offset_db = offset_db = offset_db - settings.top_db
        looks = (settings.threshold_db, settings.range_db, settings.colormap, offset_db, self._share, settings.clutter)
        cut = (settings.clip_x, settings.clip_y, settings.clip_z)
        veiled = (*looks, *cut, settings.opacity)
        if self.levels is not None:
            self._draw("points", settings.points and (*looks, *cut), self._draw_points, settings)
            self._draw("slices", settings.slices and (*veiled, settings.at), self._draw_slices, settings)
            self._draw("volume", settings.volume and veiled, self._draw_volume, settings)
            outlines = settings.slices and settings.mesh and (*cut, settings.at)
            self._draw("outlines", outlines, self._draw_outlines, settings)
        self._draw("mesh", settings.mesh and (*cut, settings.opacity), self._draw_meshes, settings)
        self._draw("cloud", bool(self.exhibit.points) and cut, self._draw_clouds, settings)
        self._draw("normals", settings.normals and cut, self._draw_normals, settings)
        self._draw("path", settings.path, self._draw_paths)
        self._draw("mask", settings.mask, self._draw_masks)
        self._draw("box", settings.box, self._draw_box)

    def _draw(self, part: str, wanted: Hashable, draw: Any, *arguments: Any) -> None:
        """Draw a part where what it depends on has changed; hide it where it is not wanted."""
        if not wanted:
            for node in self._nodes.get(part, ()):
                node.visible = False
            return
        if self._drawn.get(part) == wanted:
            for node in self._nodes[part]:
                node.visible = True
            return
        old = self._nodes.get(part, [])
        self._nodes[part] = draw(*arguments)
        self._drawn[part] = wanted
        names = {node.name for node in self._nodes[part]}
        for node in old:
            if node.name not in names:
                node.remove()

    # The image ---------------------------------------------------------------------------------------------------

    def _draw_points(self, settings: ViewSettings) -> list[Any]:
        levels = _shown(self.levels)
        self.cloud = cloud = levels.strongest(settings.threshold_db - self.offset_db, self.most, settings.limits)
        return [self._voxels("points", cloud, settings)]

    def draw_covered(self, settings: ViewSettings, lowest_db: float) -> Cloud | None:
        """Draw the points with the lid's echo beside those without it, for a page that can show both."""
        if settings.clutter or self.exhibit.levels is None or self.levels is self.exhibit.levels:
            return None
        # dB count from the maximum of what has been drawn, of either.
        cloud = self.exhibit.levels.strongest(lowest_db, self.most)
        self._voxels("covered", cloud._replace(db=cloud.db - np.float32(self.offset_db)), settings)
        return cloud._replace(db=cloud.db - np.float32(self.offset_db))

    @property
    def point_size(self) -> float:
        """Of a voxel's point [m]."""
        grid = self.levels.grid if self.levels is not None else None
        axes = () if grid is None else (grid.x, grid.y, grid.z)
        return 0.9 * min((float(np.diff(axis).mean()) for axis in axes if len(axis) > 1), default=1e-3)

    def _voxels(self, name: str, cloud: Cloud, settings: ViewSettings) -> Any:
        return self._scene.add_point_cloud(
            f"{self.name}/{name}", cloud.points - self.middle.astype(np.float32),
            settings.colours(cloud.db + np.float32(self.offset_db)), point_size=self.point_size,
            point_shape="circle", point_shading="flat", precision="float32",
        )  # fmt: skip

    def _draw_slices(self, settings: ViewSettings) -> list[Any]:
        levels, nodes = _shown(self.levels), []
        for axis, at in enumerate(settings.at):
            picture, place = levels.slice(axis, at)
            if not settings.limits[0, axis] <= place <= settings.limits[1, axis]:
                continue
            rgba = _rgba(picture + np.float32(self.offset_db), settings, settings.opacity)
            nodes += [
                self._picture(f"slice_{'xyz'[axis]}", self._cut(rgba, settings, axis), axis, place),
                self._lines(f"slice_{'xyz'[axis]}_rim", _rim(self._rest(settings), axis, place), _PLANE),
            ]
        return nodes

    def _draw_volume(self, settings: ViewSettings) -> list[Any]:
        slabs = _shown(self.levels).slabs(2, _MOST_SLABS, settings.limits)
        nodes = []
        for i, (picture, place) in enumerate(slabs):
            rgba = _rgba(picture + np.float32(self.offset_db), settings, 0.55 * settings.opacity, fading=True)
            nodes.append(self._picture(f"slab_{i}", self._cut(rgba, settings, 2), 2, place))
        return nodes

    def _rest(self, settings: ViewSettings) -> np.ndarray:
        """(2, 3) the image's box as far as it is shown [m]."""
        lower, upper = grid_box(_shown(self.levels).grid)
        return np.array([np.clip(settings.limits[0], lower, upper), np.clip(settings.limits[1], lower, upper)])

    def _cut(self, rgba: np.ndarray, settings: ViewSettings, axis: int) -> np.ndarray:
        """A picture across an axis (rows, columns, 4), transparent where it is outside of the limits."""
        lower, upper = grid_box(_shown(self.levels).grid)
        for side, i in enumerate(j for j in (2, 1, 0) if j != axis):  # rows run along the later axis
            count = rgba.shape[side]
            middles = lower[i] + (np.arange(count) + 0.5) * (upper[i] - lower[i]) / count
            hidden = (middles < settings.limits[0, i]) | (middles > settings.limits[1, i])
            np.moveaxis(rgba, side, 0)[hidden, :, 3] = 0
        return rgba

    def _picture(self, name: str, rgba: np.ndarray, axis: int, place: float) -> Any:
        """A picture in the plane across an axis, as wide as the image."""
        lower, upper = grid_box(_shown(self.levels).grid)
        width, height = (float((upper - lower)[i]) for i in range(3) if i != axis)
        position = (lower + upper) / 2
        position[axis] = place
        return self._scene.add_image(
            f"{self.name}/{name}", rgba, width, height, format="png", wxyz=_ACROSS[axis],
            position=position - self.middle, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    # What is around it -------------------------------------------------------------------------------------------

    def _draw_meshes(self, settings: ViewSettings) -> list[Any]:
        opacity = 0.3 * settings.opacity if self.levels is not None else settings.opacity
        nodes = []
        for i, mesh in enumerate(self.exhibit.meshes):
            vertices, faces = cut_mesh(mesh, settings.limits)
            if len(faces):
                nodes.append(self._scene.add_mesh_simple(
                    f"{self.name}/mesh_{i}", vertices - self.middle, faces, color=_MESHES[i % len(_MESHES)],
                    side="double",
                    opacity=opacity if opacity < 1 else None, cast_shadow=False, receive_shadow=False,
                ))  # fmt: skip
        return nodes

    def _draw_outlines(self, settings: ViewSettings) -> list[Any]:
        """Where the slices cut the meshes: drawn a little before and behind each slice, to be seen from both sides."""
        nodes = []
        for axis, at in enumerate(settings.at):
            _, place = _shown(self.levels).slice(axis, at)
            before = np.zeros(3)
            before[axis] = 2e-3 * self.radius
            for i, mesh in enumerate(self.exhibit.meshes):
                outline = clipped_segments(cut_outline(mesh, axis, place), settings.limits)
                if len(outline):
                    both = np.concatenate([outline - before, outline + before])
                    nodes.append(self._lines(f"outline_{'xyz'[axis]}_{i}", both, _CUTS[i % len(_CUTS)], 2.5))
        return nodes

    def _draw_clouds(self, settings: ViewSettings) -> list[Any]:
        """Points in space, coloured by their magnitude, those with normals with a short line along each."""
        nodes = []
        for i, cloud in enumerate(self.exhibit.points):
            kept = inside(cloud.points, settings.limits)
            magnitude = np.asarray(cloud.magnitude)
            share = magnitude[kept] / max(float(magnitude.max(initial=0.0)), 1e-30)
            db = 20 * np.log10(np.maximum(share, 1e-6))
            nodes.append(self._scene.add_point_cloud(
                f"{self.name}/cloud_{i}", (cloud.points[kept] - self.middle).astype(np.float32), settings.colours(db),
                point_size=0.008 * self.radius, point_shape="circle", precision="float32",
            ))  # fmt: skip
            if cloud.normals is not None and kept.any():
                some = np.flatnonzero(kept)
                some = some[:: max(1, -(-len(some) // _MOST_NORMALS))]
                ends = cloud.points[some] + 0.03 * self.radius * cloud.normals[some]
                lines = np.stack([cloud.points[some], ends], axis=1)
                nodes.append(self._lines(f"cloud_normals_{i}", lines, _NORMAL, 1.2))
        return nodes

    def _draw_normals(self, settings: ViewSettings) -> list[Any]:
        """The meshes' vertices as oriented points: each with a short line along its normal."""
        nodes = []
        for i, mesh in enumerate(self.exhibit.meshes):
            kept = np.flatnonzero(inside(mesh.vertices, settings.limits))
            kept = kept[:: max(1, -(-len(kept) // _MOST_NORMALS))]
            if len(kept):
                start = mesh.vertices[kept]
                ends = start + 0.04 * float(np.linalg.norm(mesh.extent)) * mesh.vertex_normals[kept]
                nodes.append(self._lines(f"normals_{i}", np.stack([start, ends], axis=1), _NORMAL, 1.2))
                nodes.append(self._scene.add_point_cloud(
                    f"{self.name}/oriented_{i}", (start - self.middle).astype(np.float32), _NORMAL,
                    point_size=0.006 * self.radius, point_shape="circle", precision="float32",
                ))  # fmt: skip
        return nodes

    def _draw_paths(self) -> list[Any]:
        nodes = []
        for i, path in enumerate(self.exhibit.paths):
            lower, upper = path.min(axis=0), path.max(axis=0)
            lower[2] = upper[2] = (lower[2] + upper[2]) / 2
            shown = path[:: -(-len(path) // _MOST_PATH)]
            nodes += [
                self._lines(f"path_{i}", path_lines(path), _PATH, 1.0),
                self._lines(f"aperture_{i}", _rim(np.array([lower, upper]), 2, upper[2]), _PATH, 2.5),
                self._scene.add_point_cloud(
                    f"{self.name}/positions_{i}", (shown - self.middle).astype(np.float32), _POSITION,
                    point_size=0.004 * self.radius, point_shape="circle", precision="float32",
                ),
            ]  # fmt: skip
        return nodes

    def _draw_masks(self) -> list[Any]:
        nodes = []
        for i, mask in enumerate(self.exhibit.masks):
            floor, ceiling = self.exhibit.bounds[:, 2]
            nodes += [
                self._lines(f"mask_{i}_{name}", np.insert(mask_borders(mask), 2, z, axis=2), _MASK, 2.5)
                for name, z in (("floor", floor), ("ceiling", ceiling))
                if mask.inside.any()
            ]
        return nodes

    def _draw_box(self) -> list[Any]:
        """The image's box, with ticks along three of its edges."""
        bounds = self.exhibit.bounds
        nodes = [self._lines("box", _box_edges(bounds), _BOX, 1.0)]
        lower, upper = bounds
        out = 0.045 * float(np.ptp(bounds, axis=0).max())
        # Along those edges that stand outside as the camera first looks.
        corners = (lower, lower, np.array([upper[0], lower[1], lower[2]]))
        away = (np.array([0, -out, 0]), np.array([-out, 0, 0]), np.array([out, -out, 0]) * 0.7)
        ticks = []
        for axis in range(3):
            start, stop = lower[axis], upper[axis]
            share = (stop - start) / max(float(np.ptp(bounds, axis=0).max()), 1e-9)  # 0 of a single place
            values = MaxNLocator(nbins=max(2, round(4 * share)), steps=[1, 2, 2.5, 5, 10]).tick_values(start, stop)
            for i, value in enumerate(v for v in values if start - 1e-9 <= v <= stop + 1e-9):
                at = corners[axis].copy()
                at[axis] = value
                ticks.append([at, at + away[axis] * 0.35])
                nodes.append(self._label(f"tick_{'xyz'[axis]}_{i}", f"{value:.4g}", at + away[axis]))
            at = corners[axis].copy()
            at[axis] = (start + stop) / 2
            nodes.append(self._label(f"axis_{'xyz'[axis]}", f"{'xyz'[axis]} [m]", at + 2.3 * away[axis]))
        nodes.append(self._lines("ticks", np.array(ticks), _BOX, 1.0))
        return nodes

    def _label(self, name: str, text: str, at: np.ndarray) -> Any:
        return self._scene.add_label(
            f"{self.name}/{name}", text.replace("-", "\u2212"), position=at - self.middle, anchor="center-center",
            font_screen_scale=0.72,
        )  # fmt: skip

    def _lines(self, name: str, segments: np.ndarray, colour: tuple[int, int, int], width: float = 1.5) -> Any:
        """(n, 2, 3) segments in the world frame."""
        return self._scene.add_line_segments(
            f"{self.name}/{name}", (segments - self.middle).astype(np.float32), colour, thickness=width,
            thickness_units="screen",
        )  # fmt: skip


def _shown(levels: Levels | None) -> Levels:
    if levels is None:
        raise ValueError("a pane without image draws none")
    return levels


def _rgba(db: np.ndarray, settings: ViewSettings, opacity: float, *, fading: bool = False) -> np.ndarray:
    """(rows, columns, 4) uint8: transparent under the threshold; where it is fading, the stronger the denser."""
    alpha = np.full(db.shape, 255 * opacity, dtype=np.float32)
    if fading:
        alpha *= np.clip(0.25 + 0.75 * (1 + db / settings.range_db), 0.25, 1)
    alpha[db < settings.threshold_db] = 0
    return np.concatenate([settings.colours(db), alpha.astype(np.uint8)[..., None]], axis=-1)


def _rim(bounds: np.ndarray, axis: int, place: float) -> np.ndarray:
    """(4, 2, 3) the rim of the plane across `axis` at `place`, in the box `bounds`."""
    u, v = (i for i in range(3) if i != axis)
    corners = np.full((4, 3), place)
    corners[:, u] = bounds[[0, 1, 1, 0], u]
    corners[:, v] = bounds[[0, 0, 1, 1], v]
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def _box_edges(bounds: np.ndarray) -> np.ndarray:
    """(12, 2, 3) the edges of a box."""
    upright = [[[bounds[i, 0], bounds[j, 1], z] for z in bounds[:, 2]] for i in (0, 1) for j in (0, 1)]
    return np.concatenate([_rim(bounds, 2, bounds[0, 2]), _rim(bounds, 2, bounds[1, 2]), upright])


def path_lines(path: np.ndarray) -> np.ndarray:
    """(n, 2, 3) segments along (P, 3) positions; of many, so many that a screen can show, and all turns."""
    moves = np.diff(path, axis=0)
    lengths = np.linalg.norm(moves, axis=1)
    turning = (moves[1:] * moves[:-1]).sum(axis=1) < 0.5 * lengths[1:] * lengths[:-1]
    every = -(-len(path) // _MOST_PATH)
    kept = np.unique(np.concatenate([np.arange(0, len(path), every), [len(path) - 1]]))
    turns = np.flatnonzero(turning) + 1
    if len(turns) <= _MOST_PATH:
        kept = np.union1d(kept, turns)
    shown = path[kept]
    return np.stack([shown[:-1], shown[1:]], axis=1)
