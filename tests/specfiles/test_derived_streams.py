"""What `check` says of what goes from one sample to the next where several streams have the signal."""

from __future__ import annotations

import pytest

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec
from tests.specfiles.test_derived_doubts import SOUND, STREAMS, told


@pytest.mark.parametrize(
    ("of", "is_told"),
    [
        ("{delta: x}", True),
        ("{previous: x}", True),
        ("{follows: x, states: {1: [2], 2: [1]}}", True),
        ("{delta: x, by: robot, forget: 1h}", False),
        ("{last: x}", False),
        ("{max: x, over: 2s}", False),
        ("{delta: speed}", False),
    ],
)
def test_samples_of_one_stream_after_the_other_are_told_of(of: str, *, is_told: bool) -> None:
    robots = "".join(f"  - {{topic: /r{n}/odom, signals: {{x: msg.x, robot: \"'r{n}'\"}}}}\n" for n in (1, 2))
    found = told(f"{robots}derive: {{m: {of}}}\n{SOUND}")
    assert len(found) == is_told
    for each in found:
        assert "derived signal 'm': its samples are those of /r1/odom and /r2/odom, one after the other" in each


def test_the_mend_keeps_streams_apart() -> None:
    text = STREAMS.replace("id: t\n", "id: t\nordering: {by: arrival}\n") + "".join(
        f"  - {{topic: /r{n}/odom, signals: {{x: msg.x, robot: \"'r{n}'\"}}}}\n" for n in (1, 2)
    )
    outcomes = {}
    for of in ("{delta: x}", "{delta: x, by: robot, forget: 1h}"):
        spec = parse_spec(
            f"{text}derive: {{m: {of}}}\nproperties: [{{id: p, formula: 'not {{m > 2}}'}}]\n", "s.yaml"
        ).spec
        ready = plan(spec)
        session = Session(ready, [make_engines(ready)[0]], begun=0)
        for n, (robot, x) in enumerate([(1, 0), (2, 9), (1, 1), (2, 10)], 1):
            session.ingest(Event(StreamKey(f"/r{robot}/odom", "topic"), "m", n, n, n, {"x": x}))
        outcomes[of] = session.judges["arrival"].told.properties[0].violations
    assert list(outcomes.values()) == [2, 0]
