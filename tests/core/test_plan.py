"""A plan says of each stream and property what looking at every atom there would say, and looks at few of them."""

from __future__ import annotations

import random
from collections.abc import Iterable

import pytest

from oracle_server.core import plan as planning
from oracle_server.core.atoms import AtomTest, specialise
from oracle_server.core.formula.tree import And, Any, Atom, Constraint, Formula, Ref, Scalar
from oracle_server.core.kinds import RESERVED, Kind
from oracle_server.core.plan import can_meet, constants, has_reserved, named_signals, plan
from oracle_server.core.spec import Property, Spec, StreamSpec

KEYS = ("v", "w", "x", "topic", "service", "kind", "call", "monitor")
VALUES: dict[str, tuple[Scalar | Any | Ref, ...]] = {
    "topic": ("/a", "/b", "/c", Any.ANY, Ref("i"), 5),
    "service": ("/a", "/s", Any.ANY),
    "kind": ("topic", "request", "response", Any.ANY),
}


@pytest.mark.parametrize("seed", range(300))
def test_each_view_has_the_tests_that_can_hold(seed: int) -> None:
    spec = _spec(random.Random(seed))
    held = frozenset[str]().union(*(s.hold for s in spec.streams))
    ready = plan(spec)
    for stream in spec.streams:
        formulas = tuple(p.atoms for p in spec.properties)
        names = named_signals(stream, formulas, held) if stream.signals is None else frozenset(stream.signals)
        own = names | {key for key in RESERVED if has_reserved(stream, key)} | held
        views = ready.streams[stream.key].views
        for prop, view in zip(spec.properties, views, strict=True):
            expected = specialise(prop.atoms, constants(stream), own.__contains__)
            assert _shown(view.tests) == _shown(expected)
            assert view.reads == {key for test in expected for key in test.reads} - RESERVED
            assert view.size == len(prop.atoms)
        if stream.signals is None:
            assert ready.streams[stream.key].project.fields == names


@pytest.mark.parametrize("seed", range(300))
def test_the_readers_are_those_that_some_event_concerns(seed: int) -> None:
    spec = _spec(random.Random(seed))
    expected: dict[str, set[int]] = {}
    for stream in spec.streams:
        expected.setdefault(stream.name, set()).update(
            i for i, p in enumerate(spec.properties) if _reads(spec, stream, p)
        )
    assert plan(spec).readers == expected


def test_atoms_that_name_another_stream_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = 0

    def counted(stream: StreamSpec, atom: Atom) -> bool:
        nonlocal looks
        looks += 1
        return can_meet(stream, atom)

    monkeypatch.setattr(planning, "can_meet", counted)
    count = 50
    streams = tuple(StreamSpec(f"/t{i}") for i in range(count))
    atoms = [Atom((Constraint("topic", "==", f"/t{i}"), Constraint("v", "==", i))) for i in range(count)]
    plan(Spec("s", streams, tuple(Property(f"p{i}", atom) for i, atom in enumerate(atoms))))
    assert looks <= 4 * count


def _reads(spec: Spec, stream: StreamSpec, prop: Property) -> bool:
    held = frozenset[str]().union(*(s.hold for s in spec.streams))
    if stream.name in prop.guards or any(c.key in stream.hold for a in prop.atoms for c in a.constraints):
        return True
    own = named_signals(stream, (prop.atoms,), held) if stream.signals is None else frozenset(stream.signals)
    read = [{c.key for c in atom.constraints} for atom in prop.atoms if can_meet(stream, atom)]
    return any(not keys.isdisjoint(own | RESERVED) for keys in read)


def _shown(tests: Iterable[AtomTest]) -> list[tuple[int, list[tuple[str, bool]], tuple[str, ...]]]:
    found = [(test.index, [(key, check is None) for key, check in test.checks], test.refs) for test in tests]
    return sorted(found)


def _spec(rng: random.Random) -> Spec:
    streams = [StreamSpec(name, "topic", signals=_signals(rng), hold=_hold(rng)) for name in ("/a", "/b", "/c")]
    kinds: tuple[Kind, ...] = ("request", "response")
    streams += [StreamSpec("/s", kind, signals=_signals(rng), hold=_hold(rng)) for kind in kinds]
    guards = [frozenset(rng.sample(["/a", "/s"], rng.choice([0, 0, 1]))) for _ in range(4)]
    return Spec("s", tuple(streams), tuple(Property(f"p{i}", _formula(rng), guards=g) for i, g in enumerate(guards)))


def _signals(rng: random.Random) -> dict[str, str] | None:
    return rng.choice([None, {"v": "msg.v"}, {"v": "msg.v", "w": "msg.w"}])


def _hold(rng: random.Random) -> frozenset[str]:
    return frozenset(rng.choice([[], [], ["v"], ["v", "w"]]))


def _formula(rng: random.Random) -> Formula:
    formula: Formula = _atom(rng)
    for _ in range(rng.randrange(3)):
        formula = And(formula, _atom(rng))
    return formula


def _atom(rng: random.Random) -> Atom:
    found = []
    for key in rng.sample(KEYS, rng.randrange(4)):
        value = rng.choice(VALUES.get(key, (1, "x", Any.ANY, Ref("i"))))
        op = rng.choice(["==", "==", "==", "!="]) if isinstance(value, str | int) else "=="
        found.append(Constraint(key, "!=" if op == "!=" else "==", value))
    return Atom(tuple(found))
