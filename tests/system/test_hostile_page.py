"""A page of another site, in the browser that shows ours: it reads nothing, writes nothing, and frames nothing."""

import http.server
import json
import threading

import numpy as np
import pytest

import millisight as ms
from helpers import browser
from helpers.browser import served

pytest.importorskip("viser", reason='needs viser: pip install "millisight[viewer]"')

# What such a page can try against an address, the secret known or not: each promise gives what it could read.
TRIES = """
const [address, done] = [arguments[0], arguments[arguments.length - 1]];
const body = JSON.stringify({method: "classical", points: [[1, 1]], labels: [1]});
const read = answer => answer.text().then(text => `read ${answer.type} ${answer.status} ${text.length}`);
const tries = {
  get: fetch(address).then(read),
  opaque: fetch(address, {mode: "no-cors"}).then(read),
  about: fetch(address + "about").then(read),
  save: fetch(address + "save", {method: "POST", body}).then(read),
  blind: fetch(address + "save", {method: "POST", mode: "no-cors", body}).then(read),
  socket: new Promise(tell => {
    const socket = new WebSocket(address.replace("http:", "ws:"), "viser-v" + arguments[1]);
    socket.onopen = () => tell("read socket");
    socket.onerror = () => tell("refused");
  }),
  stream: new Promise(tell => {
    const stream = new EventSource(address + "open");
    stream.onopen = () => tell("read stream");
    stream.onerror = () => { stream.close(); tell("refused"); };
  }),
  picture: new Promise(tell => {
    const picture = new Image();
    picture.onload = () => tell("read picture");
    picture.onerror = () => tell("refused");
    picture.src = address + "picture/radar";
  }),
  script: new Promise(tell => {
    const script = document.createElement("script");
    script.onload = () => tell("read script");
    script.onerror = () => tell("refused");
    script.src = address + "page.js";
    document.body.append(script);
  }),
};
const told = Object.entries(tries).map(
  ([name, promise]) => promise.catch(() => "refused").then(answer => [name, answer]));
Promise.all(told).then(all => done(Object.fromEntries(all)));
"""


@pytest.fixture(scope="module")
def driver():
    """A name of another site leads here, as a page there can arrange once it is shown."""
    with browser.chromium(*browser.WEBGL, "--host-resolver-rules=MAP evil.example 127.0.0.1") as driver:
        yield driver


@pytest.fixture(scope="module")
def elsewhere():
    """The address of another site's page."""

    class Page(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>evil</title><body></body>")

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://localhost:{server.server_address[1]}/"
        server.shutdown()


@pytest.fixture
def folder(tmp_path):
    grid = ms.VoxelGrid.regular((-0.05, -0.05, 0), (0.05, 0.05, 0), 0.005)
    x, y = np.meshgrid(grid.x, grid.y, indexing="ij")
    values = np.exp(-(x**2 + y**2) / 0.02**2)[:, :, None].astype(np.complex64)
    ms.save(tmp_path / "a.image.h5", ms.SarImage(grid=grid, values=values))
    return tmp_path


@pytest.mark.parametrize("command", [("view",), ("view", "--host", "0.0.0.0"), ("annotate",)], ids=" ".join)
def test_a_page_of_another_site_reads_and_writes_nothing(folder, driver, elsewhere, command):
    import viser

    files = sorted(path.name for path in folder.iterdir())
    with served(command[0], "a.image.h5", *command[1:], "--no-browser", cwd=folder) as (_, printed):
        root, secret = printed.rstrip("/").rsplit("/", 1)
        assert len(secret) >= 20
        driver.get(elsewhere)
        # Without the secret, and, since addresses may leak, with it.
        for address in (f"{root}/", f"{root}/{secret}/", f"{root}/{secret}x/"):
            told = driver.execute_async_script(TRIES, address, viser.__version__)
            assert len(told) == 9
            # An opaque answer is one that the page cannot look into.
            assert {name: answer for name, answer in told.items() if answer not in ("refused", "read opaque 0 0")} == {}
            assert {"get", "about", "save", "socket", "stream"} <= {n for n, a in told.items() if a == "refused"}
        # Framed, our page is not shown; the site learns nothing of it.
        driver.execute_script(
            "const frame = document.createElement('iframe'); frame.src = arguments[0]; document.body.append(frame)",
            f"{root}/{secret}/",
        )
        frame = driver.find_element("tag name", "iframe")
        driver.switch_to.frame(frame)
        assert not driver.execute_script("return document.body && document.body.innerText.includes('millisight')")
        driver.switch_to.default_content()
        assert json.dumps(sorted(path.name for path in folder.iterdir())) == json.dumps(files)
        # By another name for this machine there is no page.
        driver.get(f"http://evil.example:{root.rsplit(':', 1)[1]}/{secret}/")
        assert "open the address that millisight" in driver.page_source
        # And the page itself works.
        driver.get(f"{root}/{secret}/")
        assert "open the address that millisight" not in driver.page_source
        assert len(driver.page_source) > 1000
