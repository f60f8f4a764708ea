"""A receiver of alarms: a real HTTP server that answers as it is told, and keeps what comes."""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
import queue
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from tests.processes import PATIENCE

SECRET = "0123456789abcdef0123456789abcdef"


class Receiving:
    """What came; `answers` are the next statuses, then 204."""

    def __init__(self) -> None:
        self.answers: list[int] = []
        self.came: queue.Queue[tuple[dict[str, str], bytes]] = queue.Queue()
        self.held = threading.Event()
        self.held.set()
        self.url = ""

    def take(self) -> tuple[dict[str, str], dict[str, Any]]:
        """The next request's headers and alarm; its signature is that of the secret."""
        headers, body = self.came.get(timeout=PATIENCE)
        signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
        digest = base64.b64encode(hmac.new(SECRET.encode(), signed, hashlib.sha256).digest()).decode()
        assert headers["webhook-signature"] == f"v1,{digest}"
        alarm: dict[str, Any] = json.loads(body)
        assert alarm["id"] == headers["webhook-id"]
        return headers, alarm


@contextmanager
def receiving(tls: ssl.SSLContext | None = None) -> Iterator[Receiving]:
    kept = Receiving()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            kept.came.put(({k.lower(): v for k, v in self.headers.items()}, body))
            kept.held.wait(PATIENCE)
            status = kept.answers.pop(0) if kept.answers else 204
            self.send_response(status)
            if status in (302, 307):
                self.send_header("Location", "/elsewhere")
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    if tls is not None:
        server.socket = tls.wrap_socket(server.socket, server_side=True)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    kept.url = f"{'https' if tls else 'http'}://127.0.0.1:{server.server_address[1]}/alarms"
    try:
        yield kept
    finally:
        kept.held.set()
        server.shutdown()
        server.server_close()
        thread.join()
