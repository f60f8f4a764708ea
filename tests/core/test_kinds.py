"""The table of the kinds of events: consistent in itself, and the one place that says what sets kinds apart."""

from __future__ import annotations

import subprocess
import sys
from itertools import groupby
from typing import get_args

import pytest

from oracle_server.core.events import Event
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.tree import Atom
from oracle_server.core.kinds import GROUPS, KINDS, NAMING, OWN, REVISION, TICK, UNAVAILABLE, Kind, RecordKind, StepKind
from oracle_server.core.plan import can_meet, has_reserved, plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, Spec, StreamSpec
from oracle_server.engines.native import NativeEngine
from oracle_server.specfiles.load import parse_spec

OF_STREAMS: tuple[Kind, ...] = get_args(Kind)


def test_the_words_of_the_types_are_the_rows_of_the_table() -> None:
    assert set(OF_STREAMS) == {kind for kind, traits in KINDS.items() if traits.group}
    assert set(get_args(StepKind)) == KINDS.keys() == {*OF_STREAMS, TICK, REVISION}
    assert set(get_args(RecordKind)) == {*KINDS, UNAVAILABLE}


def test_a_group_has_one_leading_kind_and_one_verb_and_its_kinds_are_told_apart() -> None:
    rows = [traits for traits in KINDS.values() if traits.group]
    for _, found in groupby(rows, key=lambda traits: traits.group):
        group = list(found)
        assert [traits.leads for traits in group] == [True] + [False] * (len(group) - 1)
        assert len({traits.verb for traits in group}) == 1
        assert all(traits.verb for traits in group)
        assert len({traits.proxied for traits in group}) == 1, "an interface has a proxy or none"
        assert len({traits.noun for traits in group}) == len(group)
        assert all(traits.sole == (len(group) == 1) for traits in group)
    assert len(list(groupby(rows, key=lambda traits: traits.group))) == len(GROUPS), (
        "the kinds of a group stand together"
    )


def test_a_tick_belongs_to_no_stream_and_has_nothing_that_an_event_has() -> None:
    tick = KINDS[TICK]
    assert not tick.group
    assert not any((tick.leads, tick.has_call, tick.undoable, tick.proxied))


@pytest.mark.parametrize(
    ("kind", "signals", "undone", "name"),
    [
        ("topic", {"topic", "monitor"}, True, "/x"),
        ("request", {"service", "monitor", "call"}, True, "/x requests"),
        ("response", {"service", "monitor", "call"}, False, "/x responses"),
        ("goal", {"ros_action", "monitor", "call", "goal_id"}, True, "/x goals"),
        ("reply", {"ros_action", "monitor", "call", "goal_id", "status"}, False, "/x replies"),
        ("feedback", {"ros_action", "monitor", "goal_id"}, True, "/x feedback"),
        ("cancel", {"ros_action", "monitor", "call", "goal_id"}, False, "/x cancels"),
        ("result", {"ros_action", "monitor", "goal_id", "status"}, False, "/x results"),
        ("status", {"ros_action", "monitor", "goal_id", "status"}, False, "/x status"),
    ],
)
def test_a_stream_behaves_as_documented_for_its_kind(kind: Kind, signals: set[str], undone: bool, name: str) -> None:
    stream = StreamSpec("/x", kind, action="filter", on_deny="undo")
    assert str(stream.key) == name
    names = NAMING | {"goal_id", "status"} & OWN[stream.traits.group]
    assert {n for n in names - {"kind"} if has_reserved(stream, n)} == signals
    assert {n for n in NAMING - {"kind"} if can_meet(stream, _atom(f"{{{n}: *}}"))} == signals & NAMING
    assert [k for k in KINDS if can_meet(stream, _atom(f"{{kind: {k}}}"))] == [kind]
    guard = Property("p", _atom("{x: 1}"), guards=frozenset({"/x"}))
    assert plan(Spec("s", (stream,), (guard,))).streams[stream.key].undoes == undone


ACTION_SPEC = """
id: s
streams:
  - {topic: /battery, signals: {status: msg.data, goal_id: msg.id, ros_action: msg.name}, hold: [status]}
  - {ros_action: /go, goal: {signals: {x: msg.x}}, result: {}}
properties:
  - {id: held, formula: '{ros_action: "/go", kind: goal, status: "full", goal_id: *}'}
  - {id: own, formula: '{ros_action: "/go", kind: result, status: "aborted"}'}
  - {id: of_topic, formula: '{topic: /battery, goal_id: "b", ros_action: "/go", status: *}'}
"""


def test_the_names_that_events_of_actions_have_are_ordinary_ones_elsewhere() -> None:
    spec = parse_spec(ACTION_SPEC, "s.yaml").spec
    session = Session(plan(spec), [[NativeEngine(p.formula) for p in spec.properties]])
    battery, goal, result = (stream.key for stream in spec.streams)
    session.attach("m", [battery, goal, result], 0)
    event = Event(battery, "m", 1, 1, 1, {"data": "full", "id": "b", "name": "/go"})
    marked = Event(goal, "m", 2, 2, 2, {"x": 1}, goal_id="a")
    ended = Event(result, "m", 3, 3, 3, {"status": "no mark", "goal_id": 7}, goal_id="a", status="aborted")
    judged = [j for e in (event, marked, ended) for j in session.ingest(e)] + session.finish(4)
    assert [[v.outcome.value == "currently_true" for v in j.verdicts] for j in judged] == [
        [False, False, True],
        [True, False, False],
        [False, True, False],
    ]
    assert [dict(j.step.signals) for j in judged[1:]] == [
        {"x": 1, "goal_id": "a"},
        {"goal_id": "a", "status": "aborted"},
    ]


def _atom(text: str) -> Atom:
    formula = parse_formula(text, "steps")
    assert isinstance(formula, Atom)
    return formula


WITH_SHOPS = """
import sys
from pathlib import Path
from types import ModuleType
import oracle_server.core

TICKS = "    TICK: Traits("
ROWS = \"\"\"
    "order": Traits("shop", "orders", "orders from", leads=True, has_call=True, undoable=True, proxied=True),
    "bill": Traits("shop", "bills", "orders from", has_call=True, proxied=True),
\"\"\"
kinds = sys.modules["oracle_server.core.kinds"] = ModuleType("oracle_server.core.kinds")
source = (Path(oracle_server.core.__file__).parent / "kinds.py").read_text()
exec(source.replace(TICKS, ROWS + TICKS), vars(kinds))

from oracle_server.core.hazards.deadlocks import starvation
from oracle_server.core.events import Event
from oracle_server.core.events import Event
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.hazards.inspection import inspect
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Ordering, Property, Spec, StreamSpec
from oracle_server.core.verdicts import record
from oracle_server.engines.native import NativeEngine
from oracle_server.wire.flat import as_flat

def spec(text, **more):
    common = {"action": "filter", "on_deny": "undo", "proxy": "/go_mon", "signals": {"x": "msg.x"}}
    streams = (StreamSpec("/go", "order", **common), StreamSpec("/go", "bill", **common), StreamSpec("/a", signals={}))
    formula = parse_formula(text, "steps")
    return Spec("s", streams, (Property("p", formula, text, guards=frozenset({"/go"}), blame="caused"),), **more)

text = 'historically ({shop: "/go", kind: order} -> {shop: "/go", kind: order, x < 3, call: 7})'
sound = spec(text)
order, bill, _ = sound.streams
print(inspect(sound))
print(inspect(spec(text.replace("/go", "/stay")))[0].message)
print(next(starvation(spec(text, ordering=Ordering(max_delay=None)), ())).message.split(",")[0])
print(order.key, "|", bill.key)

ready = plan(sound)
session = Session(ready, [[NativeEngine(sound.properties[0].formula)]])
session.attach("m", [order.key, bill.key], 0)
for seq, (stream, x) in enumerate([(order, 5), (order, 2), (bill, 9)], start=1):
    event = Event(stream.key, "m", seq, seq, seq, {"x": x}, call=7, ask=True)
    for judged in session.ingest(event) + session.finish(seq):
        row = record(judged, judged.verdicts[0])
        print(row["kind"], row["step"], row["decision"], as_flat(judged.step, "go", 0))
"""
"""A spec with two kinds of a third group, which are rows in the text of the table and nothing else."""


def test_another_kind_takes_no_more_than_its_rows() -> None:
    done = subprocess.run([sys.executable, "-c", WITH_SHOPS], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "[]",
        "formula of 'p': shop '/stay' is no stream of this spec; it has /go",
        "starvation: no node of the graph orders from /go",
        "/go orders | /go bills",
        "order None deny {'shop': 'go', 'time': 0.0, 'order': {'x': 5}}",
        "order 1 allow {'shop': 'go', 'time': 0.0, 'order': {'x': 2}}",
        "bill 2 allow {'shop': 'go', 'time': 0.0, 'bill': {'x': 9}}",
    ]
