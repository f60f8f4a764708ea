"""Reads a running server over HTTP."""

from __future__ import annotations

import json
import os
import ssl
import time
from collections.abc import Iterator
from typing import Any

import httpx

from oracle_server.core.errors import OracleError

_WITHIN = 10.0
_SILENT = 60.0
"""Seconds without a sign of life, of which there is one every 15, after which a stream is opened anew."""
_RECONNECT_AFTER = 1.0


class ServerUnreachableError(OracleError):
    """A server that does not answer, or answers with an error."""


class Client:
    """Reads one server over HTTP."""

    def __init__(self, url: str, token: str | None = None) -> None:
        self._url = url.rstrip("/")
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._http = httpx.Client(
            base_url=f"{self._url}/api/v1/", headers=headers, timeout=_WITHIN, trust_env=False, verify=_tls()
        )

    def get(self, path: str, within: float = _WITHIN, **query: Any) -> dict[str, Any]:
        """A document, waited for so many seconds. Raises `ServerUnreachableError`."""
        try:
            response = self._http.get(path, params={k: v for k, v in query.items() if v is not None}, timeout=within)
            document: dict[str, Any] = response.json()
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise self._unreachable(error) from None
        except ValueError:
            raise ServerUnreachableError(f"{self._url}: answers, but not as an oracle server") from None
        if response.is_error:
            raise ServerUnreachableError(f"{self._url}: {document.get('detail', response.reason_phrase)}")
        return document

    def _unreachable(self, error: Exception) -> ServerUnreachableError:
        return ServerUnreachableError(
            f"{self._url}: can't be reached ({error}); start it with `oracle-server start`, or set ORACLE_URL"
        )

    def events(self, path: str, **query: Any) -> Iterator[dict[str, Any]]:
        """What a stream tells, over as many connections as it takes, until it says that it is closed.

        Raises `ServerUnreachableError` where there is no such stream, or no server any more.
        """
        last = 0
        while True:
            event: dict[str, str] = {}
            headers = {"Last-Event-ID": str(last)}
            try:
                with self._http.stream("GET", path, params=query, headers=headers, timeout=_SILENT) as response:
                    if response.is_error:
                        response.read()
                        raise ServerUnreachableError(f"{self._url}: {_detail(response)}")
                    for line in _lines(response):
                        name, _, value = line.decode().partition(": ")
                        if line:
                            event[name] = value
                            continue
                        if event.get("event") == "closed":
                            return
                        if "id" in event:
                            last = int(event["id"])
                            yield json.loads(event["data"])
                        event = {}
            except (httpx.RemoteProtocolError, httpx.ReadError, httpx.ReadTimeout):
                pass  # it was cut: the next one goes on where this one ended
            except (httpx.HTTPError, httpx.InvalidURL) as error:
                raise self._unreachable(error) from None
            time.sleep(_RECONNECT_AFTER)

    def lines(self, path: str) -> Iterator[bytes]:
        """The lines of a document in JSON Lines. Raises `ServerUnreachableError`."""
        try:
            with self._http.stream("GET", path) as response:
                if response.is_error:
                    response.read()
                    raise ServerUnreachableError(f"{self._url}: {_detail(response)}")
                yield from _lines(response)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise self._unreachable(error) from None

    def pages(self, path: str, **query: Any) -> list[dict[str, Any]]:
        """All the items behind a paged address."""
        items: list[dict[str, Any]] = []
        after = None
        while True:
            page = self.get(path, **query, after=after, limit=1000)
            items += page["items"]
            after = page["next"]
            if after is None:
                return items


def _lines(response: httpx.Response) -> Iterator[bytes]:
    """Lines as they come; a line feed ends them and nothing else, since JSON may hold what Python takes for an end."""
    rest = b""
    for piece in response.iter_bytes():
        *whole, rest = (rest + piece).split(b"\n")
        yield from whole
    if rest:
        yield rest


def _detail(response: httpx.Response) -> str:
    try:
        return str(response.json()["detail"])
    except (ValueError, LookupError, TypeError):
        return response.reason_phrase


def _tls() -> ssl.SSLContext:
    """As ORACLE_CA, ORACLE_CLIENT_CERT and ORACLE_CLIENT_KEY say. Raises `ServerUnreachableError`."""
    authority, cert, key = (os.environ.get(f"ORACLE_{name}") or None for name in ("CA", "CLIENT_CERT", "CLIENT_KEY"))
    try:
        context = ssl.create_default_context(cafile=authority)
        if cert:
            context.load_cert_chain(cert, key)
    except OSError as error:
        files = ", ".join(file for file in (authority, cert, key) if file)
        raise ServerUnreachableError(f"{files}: can't be used for TLS: {error.strerror or error}") from None
    return context
