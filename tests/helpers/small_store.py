"""An S3 in miniature: moto's server on this machine, whose connections can be cut and whose answers can be changed."""

import re
import socket
import threading

import boto3
from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import WSGIRequestHandler, make_server

DENIED = "<?xml version='1.0'?><Error><Code>{}</Code><Message>{}</Message></Error>"
BUCKET = "bucket"


class SmallStore:
    """Serves one bucket; `sent` are the names of objects that were put, and `fetched` those that were asked for.

    After `most_sent` of them every connection of a further one is cut. `damaged` objects arrive with other
    bytes. `denied`, (code, message), answers everything.
    """

    def __init__(self):
        self._app = DomainDispatcherApplication(create_backend_app)
        self._server = make_server("127.0.0.1", 0, self, threaded=True, request_handler=_Quiet)
        self._lock = threading.Lock()
        self._fresh()

    def _fresh(self):
        self.sent, self.fetched = [], []
        self.most_sent = 10**6
        self.damaged, self.denied = set(), None

    @property
    def endpoint(self):
        return f"http://127.0.0.1:{self._server.server_port}"

    def __enter__(self):
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()
        self.client = boto3.Session("key", "secret", region_name="us-east-1").client("s3", endpoint_url=self.endpoint)
        self.client.create_bucket(Bucket=BUCKET)
        self.sent.clear()
        return self

    def empty(self):
        """As it was when it started."""
        self._fresh()
        for name in self.names():
            self.client.delete_object(Bucket=BUCKET, Key=name)
        self._fresh()

    def __exit__(self, *_):
        self.empty()
        self.client.delete_bucket(Bucket=BUCKET)
        self.client.close()
        self._server.shutdown()
        self._server.server_close()

    def names(self):
        pages = self.client.get_paginator("list_objects_v2").paginate(Bucket=BUCKET)
        return [one["Key"] for page in pages for one in page.get("Contents", ())]

    def read(self, name):
        return self.client.get_object(Bucket=BUCKET, Key=name)["Body"].read()

    def put(self, name, content):
        self.client.put_object(Bucket=BUCKET, Key=name, Body=content)
        self.sent.remove(name)

    def __call__(self, environ, start_response):
        name = environ["PATH_INFO"].removeprefix(f"/{BUCKET}").removeprefix("/")
        if self.denied:
            start_response("403 Forbidden", [("Content-Type", "application/xml")])
            return [] if environ["REQUEST_METHOD"] == "HEAD" else [DENIED.format(*self.denied).encode()]
        if name and environ["REQUEST_METHOD"] == "PUT" and "partNumber" not in environ["QUERY_STRING"]:
            with self._lock:
                if len(self.sent) >= self.most_sent:
                    environ["werkzeug.socket"].shutdown(socket.SHUT_RDWR)
                    raise ConnectionResetError
                self.sent.append(name)
        content = self._app(environ, start_response)
        if name and environ["REQUEST_METHOD"] == "GET":
            self.fetched.append(name)
            if name in self.damaged:
                return [re.sub(rb"[^\n]", b"?", b"".join(content))]
        return content


class _Quiet(WSGIRequestHandler):
    def log(self, *_):
        pass
