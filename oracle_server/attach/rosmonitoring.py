"""ROSMonitoring's own protocol: one flat JSON event a frame, and for each the whole event back with a verdict."""

from __future__ import annotations

import asyncio
import secrets
from typing import Any

import msgspec
import structlog
from fastapi import APIRouter, WebSocket
from starlette.websockets import WebSocketDisconnect

from oracle_server.attach.throttle import Throttle
from oracle_server.core.errors import HistoryError, SpecError
from oracle_server.core.stamps import stamp_in
from oracle_server.core.verdicts import NEGATIVE, Judged, Outcome, worst
from oracle_server.edge.access import grant_of
from oracle_server.edge.problems import problem
from oracle_server.edge.scopes import needs
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import UnknownSpecError
from oracle_server.wire.errors import WireError
from oracle_server.wire.flat import decode_object, find_stream, flat_event
from oracle_server.wire.frames import Outgoing
from oracle_server.wire.incoming import AnyEvent, Attach
from oracle_server.wire.reading import event_of, suspicious

MONITOR = "legacy"
"""What a session calls the monitor that it serves: the protocol gives it no name."""
_OURS = frozenset({"verdict", "spec", "error"})
_STALLED = 5.0

log = structlog.get_logger()


def legacy_routes(registry: Registry, spec: str | None, max_rate: float = 0) -> APIRouter:
    """The addresses that old monitors connect to; `/` is that of `spec`, and refused without one.

    Each may send `max_rate` events a second on average; 0 for any number.
    """
    router = APIRouter()

    @router.websocket("/")
    @needs("submit")
    async def serve_default(socket: WebSocket) -> None:
        if spec is None:
            await _refuse(socket, "`/` has no spec; start the server with --legacy SPEC, or use /legacy/SPEC")
        else:
            await _serve(socket, registry, spec, max_rate)

    @router.websocket("/legacy/{spec_id}")
    @needs("submit")
    async def serve_named(socket: WebSocket, spec_id: str) -> None:
        await _serve(socket, registry, spec_id, max_rate)

    return router


async def _serve(socket: WebSocket, registry: Registry, spec_id: str, max_rate: float) -> None:
    if not grant_of(socket).covers(spec=spec_id):
        await _refuse(socket, "the token is bound to other specs or sessions", 403)
        return
    try:
        session = await registry.create(spec_id, None, private=True, by="arrival")
    except (UnknownSpecError, SpecError) as error:
        await _refuse(socket, str(error))
        return
    except (HistoryError, WireError) as error:
        await _refuse(socket, str(error), 503)
        return
    await LegacyConnection(socket, session, max_rate).serve()


async def _refuse(socket: WebSocket, reason: str, status: int = 404) -> None:
    await socket.send_denial_response(problem(status, reason))


class LegacyConnection:
    """Serves one old monitor, in a session of its own, until either side ends it."""

    def __init__(self, socket: WebSocket, session: LiveSession, max_rate: float = 0) -> None:
        self._throttle = Throttle(max_rate)
        self._socket, self._session = socket, session
        self._seq = 0
        self._answering: asyncio.Task[None] | None = None
        self._dropped = False
        self._over = asyncio.Event()

    def send(self, frame: Outgoing) -> None:
        """Pass over a frame that this protocol has no words for: an ack, a violation, credit."""

    def drop(self, reason: WireError) -> None:  # noqa: ARG002 -- the protocol has no word for it
        """Close: the session takes nothing more."""
        self._dropped = True
        if self._answering:
            self._answering.cancel()

    def finish(self, frame: Outgoing) -> None:
        """Pass over the confirmation of a detach, which only the end of the connection brings about."""

    async def sent(self) -> None:
        """Wait until the connection is over."""
        await self._over.wait()

    async def serve(self) -> None:
        """Accept the connection and answer each frame, in order."""
        monitor = self._session.attach(Attach(type="attach", monitor=MONITOR, instance=secrets.token_hex(8)), self)
        try:
            await self._socket.accept()
            log.info("old monitor attached", session=self._session.id)
            if not self._dropped:
                async with asyncio.TaskGroup() as tasks:
                    self._answering = tasks.create_task(self._answer_all(monitor))
            if self._dropped:
                await self._socket.close(1012)
        except (WebSocketDisconnect, RuntimeError, OSError):
            pass  # it left, and its session ends with it
        finally:
            log.info("old monitor gone", session=self._session.id)
            self._session.detach(monitor)
            self._over.set()

    async def _answer_all(self, monitor: Monitor) -> None:
        try:
            while True:
                await self._session.room()
                message = await self._socket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                reply = await self._reply(monitor, message.get("text"))
                async with asyncio.timeout(_STALLED):
                    await self._socket.send_text(reply)
                self._throttle.count()
                if self._throttle.is_due:
                    await asyncio.sleep(self._throttle.pause())
        except (WebSocketDisconnect, RuntimeError, OSError):  # TimeoutError, an OSError: it reads nothing any more
            return
        except Exception:
            log.exception("a connection failed")
            await self._socket.close(1011)

    async def _reply(self, monitor: Monitor, text: str | None) -> str:
        self._seq += 1
        value: dict[str, Any] = {}
        try:
            value = decode_object(text or "")
            judged = self._session.ingest(monitor, self._event(text or "", value))
            if self._session.oracles is not None:
                waiting = self._session.oracles.judgement(monitor.name, self._seq)
                judged = judged if waiting is None else [await waiting]
        except (ValueError, TypeError, RecursionError) as error:
            reason = "nested too deep" if isinstance(error, RecursionError) else str(error)
            self._session.refuse(monitor, WireError("bad_event", reason, seq=self._seq))
            return answered(text, value, {"verdict": Outcome.UNKNOWN, "error": f"not an event: {reason}"})
        except WireError as error:
            if error.code == "bad_event":
                self._session.refuse(monitor, error)
            return answered(text, value, {"verdict": Outcome.UNKNOWN, "error": error.message})
        return answered(text, value, verdict_of(judged, self._seq))

    def _event(self, text: str, value: dict[str, Any]) -> AnyEvent:
        flat = flat_event(value)
        spec = self._session.spec
        key = find_stream(flat.stream, flat.kind, spec.by_key)
        if key is None:
            name, stamp = flat.stream, None
        else:
            name, stamp = key.name, stamp_in(flat.data, spec.by_key[key].stamp)
        event = {"seq": self._seq, "stream": name, "kind": flat.kind, "data": flat.data}
        return event_of(event | {"stamp": stamp or flat.stamp or flat.time}, suspicious=suspicious(text))


def verdict_of(judged: list[Judged], seq: int) -> dict[str, str]:
    """What a reply says of event number `seq`: the worst over the properties, and which ones are negative.

    A deadline that ran out just before it has a verdict of its own.
    """
    own = [j for j in judged if (j.step.event.monitor, j.step.event.seq) == (MONITOR, seq)]
    verdicts = [verdict for item in own for verdict in item.verdicts]
    broken = [v.property for v in verdicts if v.outcome in NEGATIVE]
    return {"verdict": worst(v.outcome for v in verdicts).value} | ({"spec": ", ".join(broken)} if broken else {})


def answered(text: str | None, value: dict[str, Any], words: dict[str, str]) -> str:
    """A frame with words added, every byte of its other values as it came; the words alone where it is no object.

    Old monitors look a reply's event up by its `time`, so that no digit of it may change.
    """
    added = msgspec.json.encode(words).decode()
    if text is None or not value:
        return added
    if _OURS & value.keys():
        try:
            raw = msgspec.json.decode(text, type=dict[str, msgspec.Raw])
        except msgspec.DecodeError:
            pass  # a bare NaN: words stand twice, and count as they stand last
        else:
            return msgspec.json.encode({k: v for k, v in raw.items() if k not in _OURS} | words).decode()
    return f"{text.rstrip()[:-1]},{added[1:]}"
