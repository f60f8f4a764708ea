"""What monitors' streams hold: as brute force has it, and as it was at any version."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.events import Event, Step, StreamKey
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.judging.holding import Held, Holding, Version

NAMES = ("v", "w")
Told = tuple[dict[str, Scalar], set[str]]
ACT = st.tuples(
    st.sampled_from(("take", "take", "take", "back")),
    st.sampled_from("mno"),
    st.sets(st.sampled_from(NAMES), min_size=1),
    st.dictionaries(st.sampled_from(NAMES), st.integers(0, 9)),
    st.sets(st.sampled_from(NAMES)),
    st.integers(0, 99),
)


def step(signals: dict[str, Scalar], failed: set[str]) -> Step:
    sound = {name: value for name, value in signals.items() if name not in failed}
    return Step(Event(StreamKey("/a", "topic"), "m", 1, 1, 1, None), sound, frozenset(failed), 1)


def together(known: dict[str, Held]) -> Told:
    """The values that all hold, in the sequence of their last events."""
    values: dict[str, Scalar] = {}
    failed: set[str] = set()
    for held in known.values():
        values |= held.values
        failed = (failed - held.values.keys()) | held.failed
    return {name: value for name, value in values.items() if name not in failed}, failed


@settings(max_examples=1_000, deadline=None)
@given(st.lists(st.tuples(ACT, st.booleans()), max_size=40))
def test_it_is_as_brute_force_has_it_at_every_version(acts: list[tuple[tuple[str, str, set[str], dict[str, Scalar],
                                                                       set[str], int], bool]]) -> None:  # fmt: skip
    holding, known = Holding(), dict[str, Held]()
    versions: list[tuple[Version, dict[str, Held]]] = [(holding.version, {})]
    for (act, monitor, names, signals, failed, number), looks in acts:
        if act == "take":
            held = known[monitor].copy() if monitor in known else Held()
            held.take(frozenset(names), step(signals, failed))
            known = {m: h for m, h in known.items() if m != monitor} | {monitor: held}
            holding.take(monitor, frozenset(names), step(signals, failed))
            versions.append((holding.version, known))
        else:
            version, known = versions[number % len(versions)]
            holding.go_to(version)
        assert [(m, h.values, h.failed) for m, h in holding.all()] == [
            (m, h.values, h.failed) for m, h in known.items()
        ]
        if looks:
            assert holding.together() == together(known)
    assert holding.together() == together(known)
    again = Holding((m, h.copy()) for m, h in known.items())
    assert again.together() == together(known)
    assert bool(again) == bool(known)


def test_a_version_has_nothing_of_other_monitors() -> None:
    """Else 10,000 steps that are kept for late events would take as many times what thousands of monitors do."""
    holding, versions = Holding(), list[Version]()
    for number in range(1_000):
        versions.append(holding.version)
        holding.take(f"m{number % 500}", frozenset(NAMES), step({"v": number}, set()))
    before = dict(holding.all())
    holding.take("m7", frozenset(NAMES), step({"v": -1}, set()))
    after = dict(holding.all())
    assert [monitor for monitor in after if after[monitor] is not before[monitor]] == ["m7"]
    holding.go_to(versions[100])
    assert [monitor for monitor, _ in holding.all()] == [f"m{number}" for number in range(100)]
