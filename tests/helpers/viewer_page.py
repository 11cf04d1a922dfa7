"""Scripts that look into the viewer's page, and what waits for it."""

import time

_VIEWER = "const m = window.__viserMutable;"  # viser's own hook for tests of its page
POINTS = (
    _VIEWER + "let n = null; const node = m && m.nodeRefFromName[arguments[0] + '/points'];"
    "if (node) node.traverse(p => { if (p.isPoints) n = Math.min(p.geometry.attributes.position.count,"
    "p.geometry.drawRange.count) }); return n;"
)
POSITION = _VIEWER + "const n = m.nodeRefFromName[arguments[0]]; return n && n.position.toArray();"
CAMERA = (
    _VIEWER + "const root = m.nodeRefFromName['/pane0'].parent;"
    "return root.worldToLocal(m.camera.position.clone()).toArray();"
)
TURN = _VIEWER + "m.cameraControl.rotate(0.8, -0.3, false);"


def wait(condition, seconds=20):
    """Until `condition` gives something true, which is returned; software draws slowly."""
    end = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.05)
    return value
