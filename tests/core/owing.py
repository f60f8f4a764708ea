"""Sessions of properties with obligations, and what is told of these."""

from __future__ import annotations

from typing import Any

from oracle_server.core.session import Session
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import Judged, record
from oracle_server.engines.native import NativeEngine, engine_of
from tests.core.sessions import STREAMS, A, B, open_session, prop

ANSWER = "forall[g]. {goal: *g} -> eventually[:10ns] {done: *g}"


def native(property_: Property) -> NativeEngine:
    return engine_of(property_)


def opened(*properties: Property, streams: list[StreamSpec] | None = None, **ordering: Any) -> Session:
    given = STREAMS if streams is None else streams
    return open_session(
        list(properties), attach={"m": [A, B]}, streams=given, maker=native, by="arrival", **ordering
    )  # fmt: skip


def timed(**more: Any) -> Property:
    return prop("p", ANSWER, time="seconds", **more)


def records(judged: list[Judged]) -> list[dict[str, Any]]:
    return [dict(record(j, v)) for j in judged for v in j.verdicts]


def about(found: dict[str, Any]) -> list[tuple[int, dict[str, Any]]]:
    return [(each["step"], each["values"]) for each in found["about"]]
