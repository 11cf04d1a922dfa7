"""A hub in miniature: the few pages of the Hugging Face Hub's interface for downloads and uploads, on this machine."""

import base64
import hashlib
import json
import re
import threading
from functools import lru_cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote, urlsplit

REPOSITORY = "SignalKinetics/MITO_Dataset"
COMMIT = "0123456789abcdef0123456789abcdef01234567"
PAGE = 3  # entries of a listing on a page, so that there are several


@lru_cache(maxsize=1000)
def git_name(content):
    """As git names a blob."""
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


@lru_cache(maxsize=1000)
def checksum(content):
    return hashlib.sha256(content).hexdigest()


class Hub(ThreadingHTTPServer):
    """Serves `files`, {path: content}; `broken` paths break off after so many bytes, once; `refused` answer so.

    `asked` tells (method, path, Range header) of every request for a file. Small texts are `regular` files, others are
    stored by their checksums, in `blobs`, before a commit names them; `commits` are the paths of each, of which only
    `most_commits` are taken. `made` is what a new repository was asked to be.
    """

    def __init__(self, files, repository=REPOSITORY):
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files = files
        self.repository = repository
        self.regular = set()
        self.blobs = {}
        self.commits = []
        self.most_commits = 1000
        self.made = None
        self.tokens = set()
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
        if match := re.fullmatch(rf"/api/datasets/{self.server.repository}/revision/(.+)", path):
            if match[1] not in ("main", COMMIT):
                return self._answer(404, b"{}", **{"X-Error-Code": "RevisionNotFound"})
            return self._json({"id": self.server.repository, "sha": COMMIT, "siblings": []})
        if re.fullmatch(rf"/api/datasets/{self.server.repository}/tree/(main|{COMMIT})", path):
            return self._tree(int(url.query.rsplit("cursor=")[-1]) if "cursor=" in url.query else 0)
        if match := re.fullmatch(rf"/datasets/{self.server.repository}/resolve/{COMMIT}/(.+)", path):
            return self._file(match[1])
        return self._answer(404, b"{}", **{"X-Error-Code": "RepoNotFound"})

    do_HEAD = do_GET

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.tokens.add(self.headers.get("Authorization"))
        path, server = unquote(urlsplit(self.path).path), self.server
        if server.gate is not None:
            status, code = server.gate
            told = json.dumps({"error": f"refused {self.headers.get('Authorization')}"}).encode()
            return self._answer(status, told, **({"X-Error-Code": code} if code else {}))
        if path == "/api/repos/create":
            server.made = server.made or json.loads(body)
            return self._json({"url": f"{server.endpoint}/datasets/{server.repository}", "name": server.repository})
        if path == "/api/validate-yaml":
            return self._json({"errors": [], "warnings": []})
        if path == f"/api/datasets/{server.repository}/preupload/main":
            files = json.loads(body)["files"]
            small = {file["path"] for file in files if file["path"].endswith((".md", ".json", ".jsonl"))}
            return self._json({"files": [
                {"path": file["path"], "uploadMode": "regular" if file["path"] in small else "lfs",
                 "shouldIgnore": False, "oid": None} for file in files]})  # fmt: skip
        if path == f"/datasets/{server.repository}.git/info/lfs/objects/batch":
            return self._json(
                {"transfer": "basic", "objects": [self._wanted(one) for one in json.loads(body)["objects"]]}
            )
        if path == f"/api/datasets/{server.repository}/commit/main":
            return self._commit([json.loads(line) for line in body.splitlines()])
        return self._answer(404, b"{}", **{"X-Error-Code": "RepoNotFound"})

    def do_PUT(self):
        content = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.blobs[hashlib.sha256(content).hexdigest()] = content
        self._answer(200, b"")

    def _wanted(self, one):
        """Where to put an object; nowhere if it is there."""
        upload = {"upload": {"href": f"{self.server.endpoint}/blobs/{one['oid']}", "header": {}}}
        return {**one, **({} if one["oid"] in self.server.blobs else {"actions": upload})}

    def _commit(self, lines):
        if len(self.server.commits) >= self.server.most_commits:
            return self._answer(500, b"{}")
        paths = []
        for line in lines[1:]:
            value = line["value"]
            paths.append(value["path"])
            if line["key"] == "file":
                self.server.files[value["path"]] = base64.b64decode(value["content"])
                self.server.regular.add(value["path"])
            else:
                self.server.files[value["path"]] = self.server.blobs[value["oid"]]
        self.server.commits.append(paths)
        address = f"{self.server.endpoint}/datasets/{self.server.repository}/commit/{COMMIT}"
        return self._json({"commitUrl": address, "commitOid": COMMIT})

    def _tree(self, start):
        folders = sorted({"/".join(p.split("/")[: i + 1]) for p in self.server.files for i in range(p.count("/"))})
        paths = [*folders, *sorted(self.server.files)]
        tree = f"{self.server.endpoint}/api/datasets/{self.server.repository}/tree/{COMMIT}"
        more = f"{tree}?recursive=true&cursor={start + PAGE}"
        link = {"Link": f'<{more}>; rel="next"'} if start + PAGE < len(paths) else {}
        self._json([self._entry(path) for path in paths[start : start + PAGE]], **link)

    def _entry(self, path):
        if path not in self.server.files:
            return {"type": "directory", "path": path, "oid": "0" * 40, "size": 0}
        content = self.server.files[path]
        entry = {"type": "file", "path": path, "oid": git_name(content), "size": len(content)}
        if path not in self.server.regular:
            sha = checksum(content)
            entry |= {"oid": sha[:40], "lfs": {"oid": sha, "size": len(content), "pointerSize": 130}}
        return entry

    def _file(self, path):
        self.server.asked.append((self.command, path, self.headers.get("Range")))
        if path not in self.server.files:
            return self._answer(404, b"", **{"X-Error-Code": "EntryNotFound"})
        if path in self.server.refused and self.command == "GET":
            return self._answer(self.server.refused[path], b"")
        content = self.server.files[path]
        about = {
            "ETag": f'"{checksum(content)}"', "X-Repo-Commit": COMMIT, "Accept-Ranges": "bytes",
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
