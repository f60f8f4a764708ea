"""Whatever text comes in, from a monitor, an old monitor or a file: it is read, or refused in words; nothing is run."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from oracle_server.core.errors import FormulaError, SpecError
from oracle_server.core.formula.parse import parse_formula
from oracle_server.specfiles.load import parse_spec
from oracle_server.wire.data import whole
from oracle_server.wire.errors import WireError
from oracle_server.wire.flat import decode_object, flat_event
from oracle_server.wire.incoming import MAX_DEPTH, RawEvents
from oracle_server.wire.reading import decode, event_in

VECTORS = Path(__file__).parent / "vectors"
FRAMES = [
    json.dumps(step["monitor"])
    for path in sorted(VECTORS.glob("*.json"))
    for step in json.loads(path.read_text())["conversation"]
    if "monitor" in step
]
RUNNING = ("exec", "os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "socket.connect")
many = settings(max_examples=500, deadline=None, database=None)

scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20)
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4)
)
KEYS = [
    "type", "seq", "stream", "kind", "stamp", "data", "ask", "source", "call", "lost", "events", "stamps", "monitor",
    "instance", "session", "spec", "streams", "clock", "passed", "why", "topic", "service", "time", "request",
    "response", "goal_id", "status", "ros_action", "features",
]  # fmt: skip
WORDS = [
    "attach", "event", "events", "outcome", "clock", "detach", "/a", "topic", "request", "goal", "aborted", 0, 1, -1,
    2**63, 2**64, 1e308,
]  # fmt: skip
messages = st.dictionaries(st.sampled_from(KEYS), st.sampled_from(WORDS) | values, max_size=8)
texts = (
    st.text(max_size=200)
    | messages.map(json.dumps)
    | messages.map(lambda m: json.dumps({"type": "event", "seq": 1, "stream": "/a", "data": {}} | m))
    | messages.map(lambda m: json.dumps({"type": "events", "events": [m, m]}))
)
EXTREMES = ["[" * 10**6, '{"a":' * 10**5, "9" * 10**6, '"' + "\\" * 10**6, '{"type":"event","seq":1e400}', "\0"]


@contextmanager
def nothing_is_run() -> Iterator[None]:
    """Fail where anything is executed, started or connected to meanwhile."""
    seen: list[str] = []
    _watched.append(seen)
    try:
        yield
    finally:
        _watched.pop()
    assert not seen


_watched: list[list[str]] = []


def _audit(name: str, _: tuple[Any, ...]) -> None:
    if _watched and name in RUNNING:
        _watched[-1].append(name)


sys.addaudithook(_audit)


def extremes(test: Callable[..., None]) -> Callable[..., None]:
    for text in EXTREMES:
        test = example(text=text)(test)
    return test


@many
@extremes
@given(text=texts)
def test_frames(text: str) -> None:
    with nothing_is_run():
        refused = None
        try:
            frame = decode(text)
            if isinstance(frame, RawEvents):
                for raw in frame.events:
                    event_in(raw, whole)
        except WireError as error:
            refused = error
    if refused is not None:
        assert refused.message
        assert not refused.fatal
        json.dumps(refused.frame())


@many
@given(st.data())
def test_frames_with_a_piece_cut_out_or_put_in(data: st.DataObject) -> None:
    text = data.draw(st.sampled_from(FRAMES))
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, len(text)))
    with nothing_is_run(), suppress(WireError):
        decode(text[:start] + data.draw(st.text(max_size=5)) + text[end:])


@many
@given(depth=st.integers(1, 3 * MAX_DEPTH))
def test_data_is_as_deep_as_is_allowed(depth: int) -> None:
    text = '{"type":"event","seq":1,"stream":"/a","data":' + '{"a":' * depth + "1" + "}" * depth + "}"
    if depth <= MAX_DEPTH:
        decode(text)
    else:
        with pytest.raises(WireError, match="deep"):
            decode(text)


@many
@extremes
@given(text=texts)
def test_flat_events_of_old_monitors(text: str) -> None:
    with nothing_is_run(), suppress(ValueError, TypeError, RecursionError):
        flat_event(decode_object(text))


CODE = ["__import__('os').system('id')", "!!python/object/apply:os.system [id]", "{{7*7}}", "open('/etc/passwd')"]


@many
@given(code=st.sampled_from(CODE), place=st.sampled_from(["id", "signals", "formula", "type", "stamp", "key"]))
def test_no_code_in_a_spec_is_run(code: str, place: str) -> None:
    parts = dict.fromkeys(["id", "signals", "formula", "type", "stamp", "key"], "")
    parts[place] = code
    text = f"""
id: {parts["id"] or "a"}
{parts["key"] or "description"}: text
streams:
  - topic: /a
    type: {json.dumps(parts["type"]) if parts["type"] else "std_msgs/msg/Bool"}
    stamp: {json.dumps(parts["stamp"] or "header.stamp")}
    signals: {{v: {json.dumps(parts["signals"] or "msg.v")}}}
properties:
  - id: p
    formula: {json.dumps(parts["formula"] or "{v: 1}")}
"""
    with nothing_is_run(), suppress(SpecError):
        parse_spec(text, "x.yaml")
    with nothing_is_run(), suppress(FormulaError):
        parse_formula(code, "steps")
