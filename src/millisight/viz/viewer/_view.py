"""The viewer in one call."""

import sys
from dataclasses import fields
from typing import Any

from millisight.core import check_known
from millisight.viz import open_browser
from millisight.viz.viewer._contents import gather
from millisight.viz.viewer._server import HOST
from millisight.viz.viewer._settings import ViewSettings
from millisight.viz.viewer._viewer import Viewer, first_settings


def view(
    *shown: Any,
    block: bool = False,
    browser: bool = True,
    combine: bool = True,
    alpha: tuple[float, float] = (0.5, 0.5),
    unit: str | None = None,
    clutter: str = "auto",
    host: str = HOST,
    port: int | None = None,
    **settings: Any,
) -> Viewer:
    """Show images in the browser, as `millisight view` does; several stand side by side and rotate together.

    The page is served until the viewer is closed, by `close()`, or a `with` block, or the end of the program. A script
    that ends after this call passes `block=True`; a notebook does not, and goes on. Needs the extra `viewer`.

    Parameters
    ----------
    shown : SarImage; around them Mask, VolumeMask, Capture, Trajectory, TriangleMesh, SceneObject, Scene and
        PointCloud; or paths of files, as for `millisight view`
    block : wait until Ctrl-C, then close; the address is written to the standard error
    browser : open the page in a browser window, where there is one; else open the viewer's `url` yourself
    combine : make one view of the specular and the edge image of a simulation
    alpha : their weights at first (paper Eq. 8)
    unit : of mesh files whose unit is not clear: "m", "cm", "mm" or "in"
    clutter : "auto": if there is a lid over the objects in an image, open under it, its echo taken off; "lid":
        likewise, in large images too and if it is less sure; "none": open with everything in view
    host : address to listen on; "0.0.0.0" gives other machines access, without a password
    port : None: 8080, or the next free one
    **settings : to begin with: `threshold_db` and `range_db` [dB], `colormap`, `points`, `slices`, `volume`, `common`,
        `clip_x`, `clip_y` and `clip_z` [m], `top_db` [dB], `opacity`, and the others of
        `millisight.viz.viewer.ViewSettings`

    Returns
    -------
    Viewer
        With its address `url`, and `change`, `screenshot` and `close`; closed already if it did `block`.

    Raises
    ------
    DeviceError
        viser is not installed: `pip install "millisight[viewer]"`.
    InputError
        Nothing was given, or a record that cannot be shown, or a setting is impossible, or the port is taken.
    UnknownNameError
        There is no such setting.
    FileError, FormatError, DamagedFileError, MeshError
        A file cannot be read.
    """
    for name in settings:
        check_known("setting", name, [field.name for field in fields(ViewSettings)])
    contents = gather(shown, combine=combine, alpha=alpha, unit=unit, clutter=clutter)
    viewer = Viewer(contents, first_settings(contents, **settings), host=host, port=port)
    if browser:
        open_browser(viewer.url)
    if block:
        sys.stderr.write(f"viewer: {viewer.url}, press Ctrl-C to stop\n")
        sys.stderr.flush()
        viewer.wait()
    return viewer
