"""ROSMonitoring's own WebSocket protocol: each frame is one flat JSON event, and the reply is it with a verdict."""

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
from oracle_server.core.kinds import ACTIONS
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
from oracle_server.wire.reading import event_of

MONITOR = "legacy"
"""The name of a legacy monitor in its session: the protocol has no names."""
_REPLY_KEYS = frozenset({"verdict", "spec", "error"})
_NOT_FINAL: dict[tuple[str, bool], str] = {
    (Outcome.TRUE, False): Outcome.CURRENTLY_TRUE,
    (Outcome.TRUE, True): Outcome.CURRENTLY_TRUE,
    (Outcome.FALSE, False): Outcome.CURRENTLY_FALSE,
}
"""What is said in place of a final word, by whether the event's stream is filtered."""
_STALLED = 5.0
"""Seconds for which a monitor may not read its reply."""

log = structlog.get_logger()


def legacy_routes(registry: Registry, spec: str | None, max_rate: float = 0, *, finals: bool = False) -> APIRouter:
    """The addresses that legacy monitors connect to; `/` uses `spec`, and is refused without one.

    Each monitor may send `max_rate` events a second on average; 0 is no limit. `finals`: replies say `true` and `false`
    where an outcome is final, at which a monitor that only logs ends.
    """
    router = APIRouter()

    @router.websocket("/")
    @needs("submit")
    async def serve_default(socket: WebSocket) -> None:
        if spec is None:
            await _refuse(socket, "`/` has no spec; start the server with --legacy SPEC, or use /legacy/SPEC")
        else:
            await _serve(socket, registry, spec, max_rate, finals=finals)

    @router.websocket("/legacy/{spec_id}")
    @needs("submit")
    async def serve_named(socket: WebSocket, spec_id: str) -> None:
        await _serve(socket, registry, spec_id, max_rate, finals=finals)

    return router


async def _serve(socket: WebSocket, registry: Registry, spec_id: str, max_rate: float, *, finals: bool) -> None:
    if not grant_of(socket).covers(spec=spec_id):
        await _refuse(socket, "the token is bound to other specs or sessions", 403)
        return
    try:
        session = await registry.create(spec_id, None, private=True, by="arrival")
    except UnknownSpecError as error:
        await _refuse(socket, error.brief if grant_of(socket).bound else str(error))
        return
    except SpecError as error:
        await _refuse(socket, str(error))
        return
    except (HistoryError, WireError) as error:
        await _refuse(socket, str(error), 503)
        return
    await LegacyConnection(socket, session, max_rate, finals=finals).serve()


async def _refuse(socket: WebSocket, reason: str, status: int = 404) -> None:
    await socket.send_denial_response(problem(status, reason))


class LegacyConnection:
    """Serves one legacy monitor, in a session of its own, until either side ends it."""

    def __init__(self, socket: WebSocket, session: LiveSession, max_rate: float = 0, *, finals: bool = False) -> None:
        self._throttle = Throttle(max_rate)
        self._finals = finals
        self._socket, self._session = socket, session
        self._seq = 0
        self._answering: asyncio.Task[None] | None = None
        self._dropped = False
        self._over = asyncio.Event()

    def send(self, frame: Outgoing) -> None:
        """Ignore a frame that this protocol does not have: an ack, a violation, credit."""

    def drop(self, reason: WireError) -> None:  # noqa: ARG002 -- the protocol can't send it
        """Close the connection."""
        self._dropped = True
        if self._answering:
            self._answering.cancel()

    def finish(self, frame: Outgoing) -> None:
        """Ignore the confirmation of a detach: the connection has ended then."""

    async def reached(self) -> bool:
        """Whether the monitor is there: nobody else takes its name."""
        return True

    async def sent(self) -> None:
        """Wait until the connection has ended."""
        await self._over.wait()

    async def serve(self) -> None:
        """Accept the connection and answer each frame, in order."""
        wanted = Attach(type="attach", monitor=MONITOR, instance=secrets.token_hex(8), features=[ACTIONS])
        monitor = self._session.attach(wanted, self)
        try:
            await self._socket.accept()
            log.info("legacy monitor attached", session=self._session.id)
            if not self._dropped:
                async with asyncio.TaskGroup() as tasks:
                    self._answering = tasks.create_task(self._answer_all(monitor))
            if self._dropped:
                await self._socket.close(1012)
        except (WebSocketDisconnect, RuntimeError, OSError):
            pass  # the connection is lost, and its session ends with it
        finally:
            log.info("legacy monitor disconnected", session=self._session.id)
            self._session.detach(monitor)
            self._over.set()

    async def _answer_all(self, monitor: Monitor) -> None:
        try:
            while True:
                await self._session.keeping.room()
                message = await self._socket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                await self._session.share.rested()
                await self._session.caught_up()
                reply = await self._reply(monitor, message.get("text"))
                async with asyncio.timeout(_STALLED):
                    await self._socket.send_text(reply)
                self._throttle.count()
                if self._throttle.must_yield:
                    await asyncio.sleep(self._throttle.pause())
        except (WebSocketDisconnect, RuntimeError, OSError):  # also TimeoutError, where the monitor does not read
            return
        except Exception:
            log.exception("a connection failed")
            await self._socket.close(1011)

    async def _reply(self, monitor: Monitor, text: str | None) -> str:
        self._seq += 1
        value: dict[str, Any] = {}
        run = self._session.share.run
        try:
            value = run(decode_object, text or "")
            with self._session.judgements.of(monitor.name, self._seq) as judgement:
                judged = run(self._ingest, monitor, text or "", value)
                oracles = self._session.oracles
                asked = oracles is not None and oracles.is_waited_for(monitor.name, self._seq)
                if asked or judgement.is_cut:
                    judged = await judgement.whole()
        except (ValueError, TypeError, RecursionError) as error:
            reason = "nested too deep" if isinstance(error, RecursionError) else str(error)
            self._session.refuse(monitor, WireError("bad_event", reason, seq=self._seq))
            return reply_text(text, value, {"verdict": Outcome.UNKNOWN, "error": f"not an event: {reason}"})
        except WireError as error:
            if error.code == "bad_event":
                self._session.refuse(monitor, error)
            return reply_text(text, value, {"verdict": Outcome.UNKNOWN, "error": error.message})
        return reply_text(text, value, self._worded(verdict_of(judged, self._seq), judged))

    def _worded(self, reply: dict[str, str], judged: list[Judged]) -> dict[str, str]:
        """The reply without the words at which a monitor that only logs ends.

        `false` stays where the stream is filtered: a monitor that filters does not end, and one of version 1 with
        `warning: 2` lets `currently_false` pass.
        """
        if self._finals:
            return reply
        spec = self._session.spec
        streams = {
            j.step.event.stream for j in judged if (j.step.event.monitor, j.step.event.seq) == (MONITOR, self._seq)
        }
        filtered = any(key in spec.by_key and spec.by_key[key].action == "filter" for key in streams)
        return reply | {"verdict": _NOT_FINAL.get((reply["verdict"], filtered), reply["verdict"])}

    def _ingest(self, monitor: Monitor, text: str, value: dict[str, Any]) -> list[Judged]:
        return self._session.ingest(monitor, self._event(text, value))

    def _event(self, text: str, value: dict[str, Any]) -> AnyEvent:
        flat = flat_event(value)
        spec = self._session.spec
        key = find_stream(flat.stream, flat.kind, spec.by_key)
        if key is None:
            name, stamp = flat.stream, None
        else:
            name, stamp = key.name, stamp_in(flat.data, spec.by_key[key].stamp)
        event = {"seq": self._seq, "stream": name, "kind": flat.kind, "data": flat.data, **flat.marks}
        return event_of(event | {"stamp": stamp or flat.stamp or flat.time}, len(text))


def verdict_of(judged: list[Judged], seq: int) -> dict[str, str]:
    """The reply's keys for event number `seq`: the worst outcome of the properties, and which ones are negative.

    Verdicts of deadlines that expired just before it are left out.
    """
    own = [j for j in judged if (j.step.event.monitor, j.step.event.seq) == (MONITOR, seq)]
    verdicts = [verdict for item in own for verdict in item.verdicts]
    broken = [v.property for v in verdicts if v.outcome in NEGATIVE]
    return {"verdict": worst(v.outcome for v in verdicts).value} | ({"spec": ", ".join(broken)} if broken else {})


def reply_text(text: str | None, value: dict[str, Any], keys: dict[str, str]) -> str:
    """The text of an event with keys added, all its other bytes unchanged; the keys alone where it is no object.

    Legacy monitors find a reply's event by its `time`, so that no digit of it may change.
    """
    added = msgspec.json.encode(keys).decode()
    if text is None or not value:
        return added
    if _REPLY_KEYS & value.keys():
        try:
            raw = msgspec.json.decode(text, type=dict[str, msgspec.Raw])
        except msgspec.DecodeError:
            pass  # a bare NaN: the keys are there twice, and readers use the last one
        else:
            return msgspec.json.encode({k: v for k, v in raw.items() if k not in _REPLY_KEYS} | keys).decode()
    return f"{text.rstrip()[:-1]},{added[1:]}"
