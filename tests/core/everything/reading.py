"""A session's rows read plainly: all features at once, each row against the tables, from the list of all steps.

What holds is `tests/brute.py`'s, what is derived `tests/core/derived/reference.py`'s, what waits for what comes
`tests/obligations.py`'s; what is held, undone, decided, latched, told at deadlines, explained and degraded is read
here. A unit of time is a nanosecond, so that every moment between two rows can be looked at.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from copy import deepcopy

from oracle_server.core.atoms import canonical
from oracle_server.core.events import ENDED, TICKS, Event, Order
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.judging.holding import Held
from oracle_server.core.spec import Property, Spec, StreamSpec
from oracle_server.core.verdicts import FINAL, NEGATIVE, Explanation, Judged, Outcome, Verdict
from tests.brute import presence, truths
from tests.core.derived.reference import Reference
from tests.core.derived.reference import Step as Seen
from tests.core.everything.claims import check_claims
from tests.core.everything.owed import ReadingOwed, Standing
from tests.obligations import Item

_AHEAD = 60
"""How far behind a step (ns) each moment is looked at."""


class Reading(ReadingOwed):
    """Reads the rows of one order, one after the other."""

    def __init__(self, spec: Spec, order: Order, begun: int, *, decides: bool) -> None:
        self.spec, self._order, self._decides = spec, order, decides
        self._begun = self._derived_since = begun
        signals = {s.name: tuple(s.signals or ()) for s in spec.streams}
        self.reference = Reference(spec.derive, signals, frozenset[str]().union(*(s.hold for s in spec.streams)))
        self._keyed = {p.id for p in spec.properties if self._is_keyed(p)}
        self.steps: list[Seen] = []
        self.items: list[Item] = []
        self.standing = [Standing() for _ in spec.properties]
        self.present, self.degraded = 0, False
        self._held: dict[str, Held] = {}
        self._stepped = [Outcome.UNKNOWN for _ in spec.properties]
        """How all stood at the last step."""
        self._reached = 0
        self._ticked: list[tuple[int, int, Outcome]] = []
        """What ticks have changed since the last step: the property, the time, what it was told to be."""
        self.seen, self.told = Counter[str](), Counter[str]()

    def take(self, row: Judged, reached: int) -> None:
        """Read the next row; deadlines had been judged up to `reached` (ns) before it."""
        if row.step.event.stream == TICKS:
            self._tick(row)
            return
        present = self.present
        self._step(row)
        self._stepped = [state.outcome for state in self.standing]
        self._reached = 0 if self.present > present else reached  # of those before an older step the last is told again

    def _step(self, row: Judged) -> None:
        step, event = row.step, row.step.event
        stream, time = self.spec.by_key[event.stream], self._time(row)
        if not step.skipped:  # one that is may come behind an attempt alone, so that deadlines before it wait yet
            self.settle(time - 1)
        self.degraded = self.degraded or event.lost > 0 or step.forced
        if step.skipped:
            self._skipped(row, stream)
            return
        held = self._held_with(row, stream)
        found = self._seen(row, held.get(event.monitor, Held()), time)
        steps, items = [*self.steps, found], [*self.items, Item(time, dict(found.seen), frozenset(found.failed))]
        silences, before = [*self._silences(event, time)], deepcopy(self.standing)
        latest = max(time, event.arrived - self.spec.ordering.max_skew - (self.spec.ordering.max_delay or 0))
        for i, verdict in enumerate(row.verdicts):
            if looks_ahead(self.spec.properties[i].formula):
                self.read_owed(i, items, row, verdict, tick=False)
            else:
                self._read(i, steps, latest, verdict, attempt=row.number is None)
        if self._is_denied(row, stream, silences) and stream.on_deny == "undo" and self._decides:
            self._take_back(row, before)
            return
        assert row.number == len(steps)
        self.steps, self.items, self._held, self.present, self._ticked = steps, items, held, time, []
        self._derived_since = min(self._derived_since, time)
        self.seen["late" if step.late else "step"] += 1

    def _skipped(self, row: Judged, stream: StreamSpec) -> None:
        assert {v.outcome for v in row.verdicts} == {Outcome.UNKNOWN}
        guarded = any(stream.name in p.guards for p in self.spec.properties)
        assert row.decision is None or row.decision.choice == ("deny" if guarded else "allow")
        self.degraded = True

    def _take_back(self, row: Judged, before: list[Standing]) -> None:
        """A step is taken back: all stands as before, but that violations stay counted of those that denied it."""
        assert row.number is None
        assert row.decision is not None
        for prop, state, was, verdict in zip(self.spec.properties, self.standing, before, row.verdicts, strict=True):
            assert verdict.outcome not in FINAL
            if not looks_ahead(prop.formula) or prop.id in row.decision.denied_by:
                was.violations = state.violations
        self.standing = before
        self.seen["undone"] += 1

    def _time(self, row: Judged) -> int:
        step, event = row.step, row.step.event
        if self._order == "arrival":
            return max(self.present, event.arrived)
        if self.spec.by_key[event.stream].ordered:
            return max(self.present, step.time)
        return self.present or min(step.time, event.arrived)

    def _held_with(self, row: Judged, stream: StreamSpec) -> dict[str, Held]:
        """What monitors hold behind a step; the one that spoke last is the last."""
        held, monitor = {m: h.copy() for m, h in self._held.items()}, row.step.event.monitor
        if stream.hold:
            held[monitor] = mine = held.pop(monitor, Held())
            for name in stream.hold:
                mine.values.pop(name, None)
                mine.failed.discard(name)
                if name in row.step.signals:
                    mine.values[name] = row.step.signals[name]
                if name in row.step.failed:
                    mine.failed.add(name)
        return held

    def _seen(self, row: Judged, mine: Held, time: int) -> Seen:
        """What formulas see of a step, by what its monitor holds."""
        step, stream = row.step, row.step.event.stream.name
        own, lost = dict(step.signals), set(step.failed)
        kept = {name: value for name, value in mine.values.items() if name not in lost}
        seen = {**kept, **own, "topic": stream, "kind": "topic", "monitor": step.event.monitor}
        found = Seen(time, len(self.steps) + 1, stream, own, lost, seen, lost | (mine.failed - own.keys()))
        self.reference.take(self.steps, found, min(self._derived_since, time))
        return found

    def _read(self, i: int, steps: list[Seen], latest: int, verdict: Verdict, *, attempt: bool) -> None:
        """Read a step's verdict of what looks back."""
        prop, state, now = self.spec.properties[i], self.standing[i], steps[-1]
        told = f"{prop.text} ({prop.time}) at {now.stream} {now.time}: {verdict}"
        fails = state.outcome not in FINAL and self.fails(prop, now.failed, now.stream)
        if state.outcome in FINAL:
            assert _holds(verdict.outcome) is (state.outcome is Outcome.TRUE), told
        else:
            wanted = None if fails else self._holds_at(prop, steps, latest)
            assert _holds(verdict.outcome) is wanted, f"wanted {wanted}: {told}"
        assert verdict.degraded is (self.degraded or state.failures > 0), told
        state.failures += fails
        assert attempt or not prop.latch or verdict.outcome is not Outcome.CURRENTLY_FALSE, told
        self._count(state, verdict, told)
        if isinstance(verdict.explanation, Explanation):
            self.told += check_claims(self.reference, prop, verdict.explanation, steps, tick=False)

    def _holds_at(self, prop: Property, steps: list[Seen], latest: int) -> bool | None:
        """Whether a property holds at the last of some steps; None while there was no time to miss anything."""
        holds = truths(prop.formula, [(s.time, s.seen) for s in steps], prop.time)[-1]
        grace = presence(prop.formula) if prop.time == "seconds" else None
        return None if not holds and grace is not None and latest < self._begun + grace else holds

    @staticmethod
    def _count(state: Standing, verdict: Verdict, told: str) -> None:
        new = verdict.outcome in NEGATIVE and not state.negative
        assert (verdict.explanation is not None) is new, told
        if verdict.outcome is not Outcome.UNKNOWN:
            state.negative = verdict.outcome in NEGATIVE
        state.violations += new
        state.outcome = verdict.outcome

    def _is_denied(self, row: Judged, stream: StreamSpec, silences: list[bool | None]) -> bool:
        if not (row.step.event.ask and self._decides):
            assert row.decision is None
            return False
        denying = [
            prop.id
            for prop, verdict, silent in zip(self.spec.properties, row.verdicts, silences, strict=True)
            if stream.name in prop.guards
            and (
                verdict.outcome is Outcome.UNKNOWN
                or (verdict.outcome in NEGATIVE and (prop.blame == "any" or silent is not False))
            )
        ]
        assert row.decision is not None
        assert [*row.decision.denied_by] == denying, (row.decision, silences)
        assert (row.decision.choice == "deny") is bool(denying)
        return bool(denying)

    def _silences(self, event: Event, time: int) -> Iterator[bool | None]:
        """What properties that blame come to at a step without signals but those that the event's monitor holds."""
        mine = self._held.get(event.monitor, Held())
        silent = self._behind(time, len(self.steps) + 1, mine.values, mine.failed, min(self._derived_since, time))
        for prop, state in zip(self.spec.properties, self.standing, strict=True):
            if prop.blame != "caused" or not (event.ask and self._decides):
                yield None
            elif state.outcome in FINAL:
                yield state.outcome is Outcome.TRUE
            elif self.fails(prop, silent.failed, ""):
                yield None
            else:
                yield self._holds_at(prop, [*self.steps, silent], 2**63)

    def _behind(
        self, time: int, number: int, values: Mapping[str, Scalar], failed: Collection[str], begun: int
    ) -> Seen:
        """A step without signals but held ones, and what is derived there."""
        silent = Seen(time, number, "", {}, (), dict(values), set(failed))
        for d in self.spec.derive:
            self.reference._put(silent, d, self.reference._value(d, self.steps, silent, time, number, begun))
        return silent

    def silent(self, time: int, carried: Mapping[str, Scalar]) -> Seen:
        """What formulas see at a tick that carries some signals."""
        values: dict[str, Scalar] = {}
        failed: set[str] = set()
        for held in self._held.values():  # of what several hold, that of the one that spoke last
            values |= held.values
            failed = (failed - held.values.keys()) | held.failed
        values = {name: value for name, value in values.items() if name not in failed}
        values |= carried
        return self._behind(time, len(self.steps), values, failed - carried.keys(), self._derived_since)

    def carried(self, row: Judged) -> dict[str, Scalar]:
        """The signals that a tick carries for the sake of its key."""
        signals, held = row.step.signals, self.silent(0, {}).seen
        keys = {by for d in self.spec.derive for by in d.by if by in signals}
        return {k: signals[k] for k in keys if k not in held or canonical(held[k]) != canonical(signals[k])}

    def _at(self, i: int, silent: Seen) -> bool | None:
        """Whether a property holds at a tick; None where that is not known."""
        prop = self.spec.properties[i]
        if self.fails(prop, silent.failed, ""):
            return None
        return self._holds_at(prop, [*self.steps, silent], silent.time)

    def _tick(self, row: Judged) -> None:
        time, ended = row.step.stamp, row.step.event.source == ENDED
        silent = self.silent(time, self.carried(row))
        items, changed, decided = [*self.items, Item(time, None)], False, False
        assert row.number is None
        for i, (prop, verdict) in enumerate(zip(self.spec.properties, row.verdicts, strict=True)):
            state, told = self.standing[i], f"{prop.text} ({prop.time}) at a tick {silent}: {verdict}"
            if looks_ahead(prop.formula):
                decided = self.read_owed(i, items, row, verdict, tick=True, ended=ended) or decided
                continue
            if verdict.outcome is not state.outcome:
                assert prop.time == "seconds", told
                assert not ended, told
                assert state.outcome not in FINAL, told
                assert _holds(verdict.outcome) is self._at(i, silent), told
                assert (verdict.outcome is Outcome.FALSE) is (prop.latch and verdict.outcome in NEGATIVE), told
                self._ticked.append((i, time, verdict.outcome))
                changed = True
            assert verdict.degraded is (self.degraded or state.failures > 0), told
            self._count(state, verdict, told)
            if isinstance(verdict.explanation, Explanation):
                steps = [*self.steps, silent]
                self.told += check_claims(self.reference, prop, verdict.explanation, steps, tick=True)
        assert changed or decided, "a tick that changes nothing is not told"
        self.items = items if decided else self.items
        self.seen["end" if ended else "tick"] += 1

    def settle(self, until: int) -> None:
        """Up to a time all deadlines were told that change something."""
        for i, (prop, state) in enumerate(zip(self.spec.properties, self.standing, strict=True)):
            if prop.time != "seconds" or not self.steps:
                continue
            if looks_ahead(prop.formula):
                self.settle_owed(i, until)
            elif state.outcome not in FINAL and prop.id not in self._keyed:
                self._settle(i, until)

    def _settle(self, i: int, until: int) -> None:
        before, turned = self._at(i, self.silent(self.present, {})), False
        for time in range(self.present + 1, min(until, self.present + _AHEAD) + 1):
            now = self._at(i, self.silent(time, {}))
            turned, before = turned or now is not before, now
            if turned and time >= self._reached:
                turned = False
                told = (outcome for n, at, outcome in reversed(self._ticked) if n == i and at <= time)
                stood = next(told, self._stepped[i])
                assert _holds(stood) is now, f"{self.spec.properties[i].text} at {time}: {stood}, {self._ticked}"
                self.seen["turned"] += 1

    def _is_keyed(self, prop: Property) -> bool:
        """Whether a property reads what is kept by key, or what is there only while another derived signal is.

        Or an expression over such a signal, which causes no tick.
        """
        known = {d.name: d for d in self.spec.derive}
        read = {c.key for atom in tree.atoms(prop.formula) for c in atom.constraints}
        for d in reversed(self.spec.derive):
            read |= {*d.reads} if d.name in read else set()
        mine = [d for name, d in known.items() if name in read]
        return any(
            d.by
            or (d.op in ("previous", "delta") and d.of in known)
            or (d.op == "expression" and not known.keys().isdisjoint(d.operands))
            for d in mine
        )


def _holds(outcome: Outcome) -> bool | None:
    return None if outcome is Outcome.UNKNOWN else outcome not in NEGATIVE
