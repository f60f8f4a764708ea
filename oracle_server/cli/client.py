"""An HTTP client that reads a running server."""

from __future__ import annotations

import contextlib
import json
import os
import re
import ssl
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any
from urllib.parse import quote

import httpx

from oracle_server.core.errors import OracleError, one_line
from oracle_server.core.spec import UNREACHABLE

_WITHIN = 10.0
_SILENT = 60.0
"""Seconds without data after which a stream is reopened; the server sends a comment every 15 s."""
_RECONNECT_AFTER = 1.0
_UNIX = "unix://"
"""How the address of a UNIX socket begins; the rest is its path."""
_SCHEMES = ("http://", "https://", "ws://", "wss://", _UNIX)
_KEYS = {"items", "id", "n"}
"""Of which every document of the API has one: a list, what has a name, and a verdict."""
_UNSIGNED = re.compile("self.signed|local issuer")
_NO_TLS = re.compile("WRONG_VERSION_NUMBER|RECORD_LAYER_FAILURE")
_ITS_NAME = "name the server as its certificate does, or renew that"
_CUT_OFF = "complete message body"
_CUT = httpx.RemoteProtocolError, httpx.ReadError, httpx.ReadTimeout
"""Errors after which a stream is reopened where it ended."""


class ServerUnreachableError(OracleError):
    """A server that does not answer, or answers with an error."""


def of_session(name: str, *more: str) -> str:
    """The path of a session, or of what there is of it. Raises `ServerUnreachableError` where none has such a name."""
    if not name or not name.isprintable():
        raise ServerUnreachableError(f"{name!r} names no session; `oracle-server sessions` lists all")
    quoted = quote(name, safe="")
    if name in UNREACHABLE:  # as an older server may have them: so a path does not leave them out
        quoted = quoted.replace(".", "%2E")
    return "/".join(("sessions", quoted, *more))


class Client:
    """A connection to one server, by its address, which may be `unix:///PATH`, and an optional token."""

    def __init__(self, url: str, token: str | None = None) -> None:
        self._url = url.rstrip("/")
        self._shown = re.sub("^(https?)://[^/]*@", r"\1://…@", self._url)  # not the password of a proxy
        if not self._url.lower().startswith(_SCHEMES):
            what = "write http://HOST:PORT, as http://127.0.0.1:8642, or unix:///PATH"
            raise ServerUnreachableError(f"--url or ORACLE_URL: '{url}' is no address of a server; {what}")
        token = token.strip() if token else None  # files end with a newline, as secrets that are made of them do
        if token and not all("!" <= character <= "~" for character in token):
            raise ServerUnreachableError("ORACLE_TOKEN or --token: not a token; `oracle-server token add` prints one")
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        with self._reaching():
            if self._url.startswith(_UNIX):
                base, transport = "http://localhost", httpx.HTTPTransport(uds=self._url.removeprefix(_UNIX))
            else:
                base, transport = self._url, httpx.HTTPTransport(verify=_tls(), trust_env=False)
            self._http = httpx.Client(
                base_url=f"{base}/api/v1/", headers=headers, timeout=_WITHIN, trust_env=False, transport=transport
            )

    def get(self, path: str, within: float = _WITHIN, **query: Any) -> dict[str, Any]:
        """Get a document within `within` seconds. Raises `ServerUnreachableError`."""
        return self._document("GET", path, within, **query)

    def delete(self, path: str, within: float) -> dict[str, Any]:
        """Delete what a document is of, and get it as it is then. Raises `ServerUnreachableError`."""
        return self._document("DELETE", path, within)

    def put(self, path: str, content: bytes, within: float) -> dict[str, Any]:
        """Put a text, and get what is kept of it. Raises `ServerUnreachableError`."""
        return self._document("PUT", path, within, content)

    def _document(
        self, method: str, path: str, within: float, content: bytes | None = None, **query: Any
    ) -> dict[str, Any]:
        with self._reaching():
            params = {k: v for k, v in query.items() if v is not None}
            response = self._http.request(method, path, params=params, content=content, timeout=within)
            self._demand_success(response)
            document = response.json()
            if not isinstance(document, dict) or document.keys().isdisjoint(_KEYS):
                raise ValueError
        return document

    @contextlib.contextmanager
    def _reaching(self) -> Iterator[None]:
        """Turn the errors of a request into `ServerUnreachableError`."""
        try:
            yield
        except (httpx.HTTPError, httpx.InvalidURL, UnicodeEncodeError) as error:
            what = _what_to_do(error, self._url)
            raise ServerUnreachableError(f"{self._shown}: can't be reached ({error}); {what}") from None
        except (ValueError, LookupError):
            raise ServerUnreachableError(f"{self._shown}: answers, but not as an oracle server") from None

    def events(self, path: str, note: Callable[[str], object], **query: Any) -> Iterator[dict[str, Any]]:
        """The records of a stream until its end, over several connections if necessary; `note` is told what it lacks.

        Raises `ServerUnreachableError` where there is no such stream, or the server can't be reached again.
        """
        last = 0
        while True:
            headers = {"Last-Event-ID": str(last)}
            with (
                self._reaching(),
                self._http.stream("GET", path, params=query, headers=headers, timeout=_SILENT) as response,
            ):
                self._demand_success(response, "text/event-stream")
                with contextlib.suppress(*_CUT):
                    for event in _events(_lines(response)):
                        if event.get(b"event") == b"closed":
                            return
                        if event.get(b"event") == b"missed":
                            found = json.loads(event[b"data"])
                            note(found["why"])
                            last = found["next"] - 1
                        if b"id" in event:
                            yield json.loads(event[b"data"])
                            last = int(event[b"id"])
            time.sleep(_RECONNECT_AFTER)

    def lines(self, path: str) -> Iterator[bytes]:
        """The lines of a document in JSON Lines. Raises `ServerUnreachableError`."""
        with self._reaching(), self._http.stream("GET", path) as response:
            self._demand_success(response, "application/jsonl")
            yield from _lines(response)

    def _demand_success(self, response: httpx.Response, kind: str = "application/json") -> None:
        """Raise `ServerUnreachableError` with what an error says, ValueError where it is no answer of such a kind."""
        if response.is_error:
            response.read()
            raise ServerUnreachableError(f"{self._shown}: {_detail(response)}")
        if response.has_redirect_location:  # as a proxy has it: who is sent on may be sent to anybody, with a token
            to = one_line(response.headers["location"]).partition("?")[0].partition("/api/v1/")[0]
            what = "which is not followed: name that server by --url or ORACLE_URL, if it is meant"
            raise ServerUnreachableError(f"{self._shown}: answers {response.status_code} with {to}, {what}")
        if not response.headers.get("content-type", "").startswith(kind):
            raise ValueError

    def pages(self, path: str, **query: Any) -> list[dict[str, Any]]:
        """The items of all pages of a list. Raises `ServerUnreachableError`."""
        items: list[dict[str, Any]] = []
        after = None
        while True:
            page = self.get(path, **query, after=after, limit=1000)
            items += page["items"]
            after = page["next"]
            if after is None:
                return items


def _lines(response: httpx.Response) -> Iterator[bytes]:
    """The lines of a response, split at newlines only: JSON texts may contain the other ends of `str.splitlines`."""
    rest = b""
    for chunk in response.iter_bytes():
        *lines, rest = (rest + chunk).split(b"\n")
        yield from lines
    if rest:
        yield rest


def _events(lines: Iterable[bytes]) -> Iterator[dict[bytes, bytes]]:
    """The fields of each complete Server-Sent Event."""
    event: dict[bytes, bytes] = {}
    for line in lines:
        if line:
            name, _, value = line.partition(b": ")
            event[name] = value
        elif event:
            yield event
            event = {}


def _detail(response: httpx.Response) -> str:
    try:
        return str(response.json()["detail"])
    except (ValueError, LookupError, TypeError):
        return f"answers {response.status_code}, and not as an oracle server"


def _what_to_do(error: Exception, url: str) -> str:
    """What to do about a server that can't be reached, by how that failed."""
    text = str(error)
    if "certificate verify failed" in text:
        return "ORACLE_CA names the file of the authority that signed it" if _UNSIGNED.search(text) else _ITS_NAME
    if url.lower().startswith("https:") and _NO_TLS.search(text):
        return "where the server has no TLS, write http://"
    if _CUT_OFF in text:
        return "its answer was cut off, as where the server ended or failed meanwhile: try again, or look at its log"
    if url.lower().startswith("http:") and isinstance(error, httpx.RemoteProtocolError | httpx.ReadError):
        return "where the server has TLS, write https://"
    if isinstance(error, httpx.ReadTimeout):
        return "it is busy, or stands still: try again, or look at its log"
    return "start it with `oracle-server start`, or set ORACLE_URL"


def _tls() -> ssl.SSLContext:
    """TLS by ORACLE_CA, ORACLE_CLIENT_CERT and ORACLE_CLIENT_KEY. Raises `ServerUnreachableError`."""
    authority, cert, key = (os.environ.get(f"ORACLE_{name}") or None for name in ("CA", "CLIENT_CERT", "CLIENT_KEY"))
    try:
        context = ssl.create_default_context(cafile=authority)
        if cert:
            context.load_cert_chain(cert, key)
    except OSError as error:
        files = ", ".join(file for file in (authority, cert, key) if file)
        raise ServerUnreachableError(f"{files}: can't be used for TLS: {error.strerror or error}") from None
    return context
