"""What an engine can do is found once for its class, and is the same for each of them."""

from __future__ import annotations

from itertools import product

import pytest

from oracle_server.core.engine import (
    Bounded,
    Broken,
    Engine,
    Explaining,
    Measuring,
    Receiving,
    Revisable,
    Rewindable,
    Savable,
    provides,
)
from oracle_server.core.owing import Guarding, Owing
from oracle_server.core.plan import plan
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

SPEC = """
id: s
ordering: {by: arrival}
streams:
  - {topic: /t, signals: {v: msg.v}}
properties:
  - {id: back, formula: 'once {v: 1}'}
  - {id: ahead, time: seconds, formula: '{v: 1} -> eventually[:1s] {v: 2}'}
  - {id: twice, engine: both, formula: 'once {v: 1}'}
  - {id: other, engine: reelay, formula: 'once {v: 1}'}
  - {id: numeric, engine: rtamt, formula: 'v > 1'}
  - {id: elsewhere, engine: external, url: 'ws://127.0.0.1:1'}
"""
PROTOCOLS: tuple[type, ...] = (
    Bounded, Explaining, Guarding, Measuring, Owing, Receiving, Revisable, Rewindable, Savable,
)  # fmt: skip


@pytest.fixture
def engines() -> list[Engine]:
    ready = plan(parse_spec(SPEC, "spec.yaml").spec)
    return [*make_engines(ready)[0], *make_engines(ready)[0], Broken(None)]


def test_what_is_known_of_a_class_is_so_of_each_engine(engines: list[Engine]) -> None:
    found = {(type(e), p): provides(e, p) for e, p in product(engines, PROTOCOLS)}
    assert len({type(e) for e in engines}) > 4
    for engine, protocol in product(engines, PROTOCOLS):
        assert provides(engine, protocol) is isinstance(engine, protocol) is found[type(engine), protocol]
    assert set(found.values()) == {True, False}
