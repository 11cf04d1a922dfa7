"""A scan with devices, real or virtual, and the page that shows its images while they grow; for `collect`."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from millisight.cli.console import progress, say

if TYPE_CHECKING:
    from millisight.data import VoxelGrid
    from millisight.rig import Arm, Camera, RadarDevice, ScanPlan, ScanWriter


class Devices(Protocol):
    """What scans: a virtual rig, or the devices of a rig file."""

    @property
    def arm(self) -> "Arm": ...
    @property
    def radars(self) -> "Sequence[RadarDevice]": ...
    @property
    def camera(self) -> "Camera | None": ...
    @property
    def plan(self) -> "ScanPlan": ...


def scan(devices: Devices, writer: "ScanWriter", *, enough: Callable[[], bool] | None = None) -> None:
    """Scan, with a bar; until `enough` says so."""
    from millisight.rig import record_scan

    with progress("scan") as report:
        record_scan(
            devices.arm, devices.radars, devices.camera, devices.plan, writer, progress=report, enough=enough
        )  # fmt: skip


def published_grids(devices: Devices, background: str) -> "dict[str, VoxelGrid]":
    """By the radars' names, the voxels of the published images over what the object stands on."""
    from millisight.io.mito import published_grid

    return {radar.name: published_grid(radar.name, background) for radar in devices.radars}


def scan_live(
    devices: Devices,
    writer: "ScanWriter",
    *,
    title: str,
    grids: "Mapping[str, VoxelGrid]",
    origin: Sequence[float],
    browser: bool,
) -> None:
    """Scan with a page that shows the images as they grow, and ends the scan when it is told to.

    Images have the `grids` by the radars' names, in a frame whose `origin` is in the arm's base frame [m].
    """
    from millisight.rig import LiveImaging
    from millisight.viz import open_browser
    from millisight.viz.live import LivePage

    with LivePage(title, len(devices.plan.rows)) as page:
        imaging = LiveImaging(writer, grids, origin=origin, shown=page.show)
        say(f"live image at {page.address}")
        if browser:
            open_browser(page.address)
        scan(devices, imaging, enough=lambda: page.stop_asked)
        ended = "ended early, as asked" if page.stop_asked else "all rows are scanned"
        page.end(f"{ended}; written to {writer.path}")
        for name, lag in imaging.lags.items():
            say(f"{name}: images {lag:.1f} s behind the arm at most, {ended}")
        if imaging.trouble is not None:
            say(f"note: the live image stopped: {imaging.trouble}; the scan is whole")
        page.wait_for_last_look()
