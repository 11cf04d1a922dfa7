"""A hub in miniature: the few pages of the Hugging Face Hub's interface that a download asks for, on this machine."""

import hashlib
import json
import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote, urlsplit

REPOSITORY = "SignalKinetics/MITO_Dataset"
COMMIT = "0123456789abcdef0123456789abcdef01234567"
PAGE = 3  # entries of a listing on a page, so that there are several


class Hub(ThreadingHTTPServer):
    """Serves `files`, {path: content}; `broken` paths break off after so many bytes, once; `refused` answer so.

    `asked` tells (method, path, Range header) of every request for a file.
    """

    def __init__(self, files):
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files = files
        self.broken = {}
        self.refused = {}
        self.gate = None
        self.asked = []

    @property
    def endpoint(self):
        return f"http://127.0.0.1:{self.server_address[1]}"

    def __enter__(self):
        threading.Thread(target=self.serve_forever, args=(0.02,), daemon=True).start()
        return self

    def __exit__(self, *_):
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Hub

    def do_GET(self):
        url = urlsplit(self.path)
        path = unquote(url.path)
        if self.server.gate is not None:
            status, code = self.server.gate
            return self._answer(status, b"{}", **{"X-Error-Code": code} if code else {})
        if match := re.fullmatch(rf"/api/datasets/{REPOSITORY}/revision/(.+)", path):
            if match[1] not in ("main", COMMIT):
                return self._answer(404, b"{}", **{"X-Error-Code": "RevisionNotFound"})
            return self._json({"id": REPOSITORY, "sha": COMMIT, "siblings": []})
        if re.fullmatch(rf"/api/datasets/{REPOSITORY}/tree/{COMMIT}", path):
            return self._tree(int(url.query.rsplit("cursor=")[-1]) if "cursor=" in url.query else 0)
        if match := re.fullmatch(rf"/datasets/{REPOSITORY}/resolve/{COMMIT}/(.+)", path):
            return self._file(match[1])
        return self._answer(404, b"{}", **{"X-Error-Code": "RepoNotFound"})

    do_HEAD = do_GET

    def _tree(self, start):
        folders = sorted({"/".join(p.split("/")[: i + 1]) for p in self.server.files for i in range(p.count("/"))})
        entries = [{"type": "directory", "path": path, "oid": "0" * 40, "size": 0} for path in folders]
        for path, content in sorted(self.server.files.items()):
            sha = hashlib.sha256(content).hexdigest()
            pointer = {"oid": sha, "size": len(content), "pointerSize": 130}
            entries.append({"type": "file", "path": path, "oid": sha[:40], "size": len(content), "lfs": pointer})
        more = f"{self.server.endpoint}/api/datasets/{REPOSITORY}/tree/{COMMIT}?recursive=true&cursor={start + PAGE}"
        link = {"Link": f'<{more}>; rel="next"'} if start + PAGE < len(entries) else {}
        self._json(entries[start : start + PAGE], **link)

    def _file(self, path):
        self.server.asked.append((self.command, path, self.headers.get("Range")))
        if path not in self.server.files:
            return self._answer(404, b"", **{"X-Error-Code": "EntryNotFound"})
        if path in self.server.refused and self.command == "GET":
            return self._answer(self.server.refused[path], b"")
        content = self.server.files[path]
        about = {
            "ETag": f'"{hashlib.sha256(content).hexdigest()}"', "X-Repo-Commit": COMMIT, "Accept-Ranges": "bytes",
            "X-Linked-Size": str(len(content)),
        }  # fmt: skip
        start = 0
        if match := re.fullmatch(r"bytes=(\d+)-", self.headers.get("Range") or ""):
            start = int(match[1])
            about["Content-Range"] = f"bytes {start}-{len(content) - 1}/{len(content)}"
        stop = self.server.broken.pop(path, None) if self.command == "GET" else None
        return self._answer(206 if start else 200, content[start:], stop=stop, **about)

    def _json(self, value, **headers):
        self._answer(200, json.dumps(value).encode(), **{"Content-Type": "application/json", **headers})

    def _answer(self, status, body, *, stop=None, **headers):
        self.send_response(status)
        for name, value in {"Content-Length": str(len(body)), **headers}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body[:stop])
            if stop is not None:
                self.wfile.flush()
                self.close_connection = True

    def log_message(self, *_):
        pass
