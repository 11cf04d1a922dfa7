"""A scan with devices, real or virtual, and the page that shows its images while they grow; for `collect`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from millisight.cli.console import progress, say

if TYPE_CHECKING:
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


def scan(devices: Devices, writer: "ScanWriter") -> None:
    """Scan, with a bar."""
    from millisight.rig import record_scan

    with progress("scan") as report:
        record_scan(devices.arm, devices.radars, devices.camera, devices.plan, writer, progress=report)


def scan_live(
    devices: Devices,
    writer: "ScanWriter",
    *,
    title: str,
    origin: Sequence[float],
    background: str,
    browser: bool,
) -> None:
    """Scan with a page that shows the images as they grow, and ends the scan when it is told to.

    Images have the published grid over the `background`, in a frame whose `origin` is in the arm's base frame [m].
    """
    from millisight.io.mito import published_grid
    from millisight.rig import LiveImaging, record_scan
    from millisight.viz import open_browser
    from millisight.viz.live import LivePage

    plan = devices.plan
    with LivePage(title, len(plan.rows)) as page:
        grids = {radar.name: published_grid(radar.name, background) for radar in devices.radars}
        imaging = LiveImaging(writer, grids, origin=origin, shown=page.show)
        say(f"live image at {page.address}")
        if browser:
            open_browser(page.address)
        with progress("scan") as report:
            record_scan(
                devices.arm, devices.radars, devices.camera, plan, imaging, progress=report,
                enough=lambda: page.stop_asked,
            )  # fmt: skip
        ended = "ended early, as asked" if page.stop_asked else "all rows are scanned"
        page.end(f"{ended}; written to {writer.path}")
        for name, lag in imaging.lags.items():
            say(f"{name}: images {lag:.1f} s behind the arm at most, {ended}")
        if imaging.trouble is not None:
            say(f"note: the live image stopped: {imaging.trouble}; the scan is whole")
        page.wait_for_last_look()
