"""What a row says of obligations, read plainly; and how properties stand, as far as rows have told it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import accumulate

from oracle_server.core.atoms import canonical
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import obligation
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.spec import Property, Spec
from oracle_server.core.verdicts import FINAL, Judged, Outcome, Verdict, record
from tests.brute import Fresh, Values
from tests.core.derived.reference import Reference
from tests.core.everything.claims import check_owed
from tests.obligations import Item, decisions

Told = dict[tuple[int, str], str]


@dataclass
class Held:
    """What a monitor holds."""

    values: dict[str, Scalar] = field(default_factory=dict)
    failed: set[str] = field(default_factory=set)


@dataclass
class Standing:
    """How a property stands, as far as it was told."""

    outcome: Outcome = Outcome.UNKNOWN
    negative: bool = False
    violations: int = 0
    failures: int = 0
    done: Told = field(default_factory=dict)
    known: list[int] = field(default_factory=list)
    """The items that count for its obligations."""


class ReadingOwed:
    """The part of a reading that is about obligations."""

    spec: Spec
    reference: Reference
    items: list[Item]
    present: int
    standing: list[Standing]

    seen: Counter[str]
    """What happened, and how often."""
    told: Counter[str]
    """What explanations claimed."""

    def _known(self, prop: Property, items: list[Item], numbers: list[int], *, ended: bool = False) -> Told:
        found = obligation(prop.formula)
        assert found is not None
        given = [items[n] for n in numbers]
        values = {canonical(v): v for item in given for v in (item.signals or {}).values()}
        keys: list[Values] = [{}]
        for name in found.variables:
            keys = [{**known, name: v} for known in keys for v in values.values()]
        known = decisions(prop.formula, given, prop.time, keys, ended=ended)
        texts = [_text({name: v for name, v in key.items() if not isinstance(v, Fresh)}) for key in keys]
        return {(n, texts[k]): value for (n, k), value in known.items()}

    def read_owed(
        self, i: int, items: list[Item], row: Judged, verdict: Verdict, *, tick: bool, ended: bool = False
    ) -> bool:
        """Read a verdict of what waits for what comes, where these are all `items`; whether something is decided."""
        prop, state = self.spec.properties[i], self.standing[i]
        attempt = row.number is None and not tick
        if ended and prop.at_end != "violated":
            assert verdict.outcome is state.outcome
            return False
        if tick and prop.time != "seconds" and not ended:
            assert verdict.outcome is state.outcome
            return False
        if state.outcome in FINAL:
            assert verdict.outcome is (state.outcome.current if attempt else state.outcome), prop.text
            return False
        numbers = state.known if ended else [*state.known, len(items) - 1]
        known = self._known(prop, items, numbers, ended=ended)
        new = {at: value for at, value in known.items() if value != "open" and at not in state.done}
        told = f"{prop.id} {prop.text} ({prop.time}) at {row.step.stamp}, new {new}: {verdict}"
        about = record(row, verdict).get("about", ())
        given = [(each["step"] - 1, _text(each["values"])) for each in about]
        beside = attempt and row.decision is not None and prop.id not in row.decision.denied_by
        wanted = [] if beside else sorted(at for at, value in new.items() if value == "false")
        assert sorted(given) == wanted, told
        if not attempt:
            opened = sum(value == "open" for value in known.values())
            assert verdict.pending == (0 if verdict.outcome in FINAL else opened), told
        if about:
            assert verdict.outcome is (Outcome.FALSE if prop.latch and not attempt else Outcome.CURRENTLY_FALSE), told
            assert verdict.explanation is not None, told
            reached = accumulate((items[k].time for k in numbers), max)
            times = [time for time, k in zip(reached, numbers, strict=True) if items[k].signals is not None]
            self.told += check_owed(prop, verdict.explanation, about, times)
        elif not tick:
            fails = self.fails(prop, items[-1].failed, row.step.event.stream.name)
            assert verdict.outcome is (Outcome.UNKNOWN if fails else Outcome.CURRENTLY_TRUE), told
        else:
            assert verdict.outcome in (state.outcome, Outcome.CURRENTLY_TRUE), told
        state.violations += len(about)
        if (new or not tick) and not ended:
            state.known = numbers
        state.done, state.outcome = {**state.done, **new}, verdict.outcome
        self.seen.update(f"owed {value}{' by time' if tick else ''}" for value in new.values())
        return bool(new)

    def fails(self, prop: Property, failed: Collection[str], stream: str) -> bool:
        """Whether what a property reads at an event of a stream, or a tick, has failed."""
        read = (atom for atom in tree.atoms(prop.formula) if self.reference.reads(atom, stream))
        return any(c.key in failed for atom in read for c in atom.constraints)

    def settle_owed(self, i: int, until: int) -> None:
        """Up to a time nothing is decided that was not told."""
        prop, state = self.spec.properties[i], self.standing[i]
        if state.outcome in FINAL or until <= self.present:
            return
        items = [*self.items, Item(until, None)]
        known = self._known(prop, items, [*state.known, len(items) - 1])
        missed = {at for at, value in known.items() if value != "open" and at not in state.done}
        assert not missed, f"{prop.text}: {missed} were decided by {until}"


def _text(values: Mapping[str, Scalar]) -> str:
    return " ".join(canonical(value) for value in values.values())
