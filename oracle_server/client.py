"""What the command line reads from a running server."""

from __future__ import annotations

import json
import os
import ssl
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

import httpx
from rich.console import Console
from rich.table import Table

from oracle_server.core.errors import OracleError
from oracle_server.reasons import told
from oracle_server.tokens import Token

_WITHIN = 10.0
_EXPLAINED_WITHIN = 600.0
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
            headers = {"Last-Event-ID": str(last)}
            try:
                with self._http.stream("GET", path, params=query, headers=headers, timeout=_SILENT) as response:
                    if response.is_error:
                        response.read()
                        raise ServerUnreachableError(f"{self._url}: {_detail(response)}")
                    for line in response.iter_lines():
                        name, _, value = line.partition(": ")
                        if (name, value) == ("event", "closed"):
                            return
                        if name == "id":
                            last = int(value)
                        elif name == "data":
                            yield json.loads(value)
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
                yield from (line.encode() for line in response.iter_lines())
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


def show_specs(client: Client, *, as_json: bool) -> None:
    """Print the specs on hand."""
    document = client.get("specs")
    rows = [(s["id"], str(len(s["streams"])), str(len(s["properties"])), s["description"]) for s in document["items"]]
    _show(document, ("spec", "streams", "properties", "description"), rows, as_json=as_json)


def show_sessions(client: Client, *, as_json: bool) -> None:
    """Print all sessions."""
    document = client.get("sessions")
    rows = [_session_row(state) for state in document["items"]]
    _show(document, ("session", "spec", "status", "monitors", "steps", "violations"), rows, as_json=as_json)


def show_verdicts(client: Client, session: str, properties: list[str], outcomes: list[str], *, as_json: bool) -> None:
    """Print a session's verdict records, or a summary of its properties and all violations as tables."""
    if as_json or properties or outcomes:
        items = client.pages(f"sessions/{session}/verdicts", property=properties, outcome=outcomes)
        _show({"items": items}, _RECORD, [_record_row(r) for r in items], as_json=as_json)
        return
    state = client.get(f"sessions/{session}")
    rows = [
        (p["id"], p["outcome"], str(p["violations"]), str(p["first_violation"] or "-"), str(p["unknown"]))
        for p in state["properties"]
    ]
    _show(state, ("property", "outcome", "violations", "first at", "unknown"), rows, as_json=False)
    violations = client.pages(f"sessions/{session}/violations")
    if violations:
        sys.stdout.write("\n")
        _show({}, _RECORD, [_record_row(r) for r in violations], as_json=False)
        sys.stdout.write("\n" + "".join(f"{r['n']}: {r['explanation']['text']}\n" for r in violations))


def follow_verdicts(client: Client, session: str, properties: list[str], outcomes: list[str], *, as_json: bool) -> None:
    """Print a session's verdict records, a line each, as they come."""
    for record in client.events(f"sessions/{session}/stream", property=properties, outcome=outcomes):
        line = json.dumps(record) if as_json else "  ".join(_record_row(record)).rstrip()
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


def show_explanation(client: Client, session: str, n: int, *, as_json: bool) -> None:
    """Print why a verdict is as it is."""
    record = client.get(f"sessions/{session}/verdicts/{n}/explanation", _EXPLAINED_WITHIN)
    sys.stdout.write(json.dumps(record) + "\n" if as_json else told(record))


def show_tokens(tokens: Sequence[Token], *, as_json: bool) -> None:
    """Print what tokens are good for."""
    items = [t.model_dump(mode="json", exclude={"sha256"}) for t in tokens]
    cells = [[", ".join(sorted(item[key])) if item[key] else "all" for key in _BOUND] for item in items]
    rows = [(item["name"], *cell) for item, cell in zip(items, cells, strict=True)]
    _show({"items": items}, ("token", *_BOUND), rows, as_json=as_json)


_BOUND = ("scopes", "specs", "sessions")
_RECORD = ("n", "step", "property", "outcome", "stream", "kind", "decision", "")


def _record_row(record: dict[str, Any]) -> tuple[str, ...]:
    marks = " ".join(mark for mark in ("late", "skewed", "degraded") if record[mark])
    cells = (record[key] for key in _RECORD[:-1])
    return (*("-" if cell is None else str(cell) for cell in cells), marks)


def _session_row(state: dict[str, Any]) -> tuple[str, ...]:
    attached = sum(m["connected"] for m in state["monitors"])
    violations = sum(p["violations"] for p in state["properties"])
    return (
        state["id"],
        state["spec"],
        state["status"],
        str(attached),
        str(state["counters"]["steps"]),
        str(violations),
    )


def _show(document: dict[str, Any], head: tuple[str, ...], rows: Sequence[tuple[str, ...]], *, as_json: bool) -> None:
    if as_json:
        sys.stdout.write(json.dumps(document) + "\n")
        return
    table = Table(*head, box=None, pad_edge=False)
    for row in rows:
        table.add_row(*row)
    Console(highlight=False, width=None if sys.stdout.isatty() else 160).print(table)
