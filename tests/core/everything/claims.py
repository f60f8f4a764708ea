"""Whether what explanations claim is so: of events, values, steps and windows, of derived signals and obligations."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from oracle_server.core.atoms import meets
from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import obligation
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.tree import Constraint, Formula, Scalar
from oracle_server.core.records import AboutRecord
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import Explanation
from tests.brute import truths
from tests.core.derived.reference import Reference
from tests.core.derived.reference import Step as Seen


def check_claims(
    reference: Reference, prop: Property, told: Explanation, steps: Sequence[Seen], *, tick: bool
) -> Counter[str]:
    """What is claimed of a property that does not hold at the last of all steps; how many claims of which kind."""
    claims = _Claims(reference, prop, told, steps, tick)
    claims.check()
    return claims.seen


class _Claims:
    def __init__(
        self, reference: Reference, prop: Property, told: Explanation, steps: Sequence[Seen], tick: bool
    ) -> None:
        self._reference, self._prop, self._told, self._tick = reference, prop, told, tick
        self._steps, self._now = steps, steps[-1]
        self._reasons = [*_walk(told.why["reasons"] if told.why else ())]
        self.seen = Counter[str]()

    def __str__(self) -> str:
        steps = [(s.time, s.seen, s.failed) for s in self._steps]
        return f"{self._prop.text} ({self._prop.time}): {self._told.text}\n{json.dumps(self._told.why)}\n{steps}"

    def check(self) -> None:
        """All that is claimed."""
        for reason in self._reasons:
            self._reason(reason)
        self._suffices()
        taken = self._steps[:-1] if self._tick else self._steps
        asked = [a for a in tree.atoms(self._prop.formula) if self._reference.reads(a, self._now.stream)]
        names = {c.key for atom in asked for c in atom.constraints}
        for d in self._reference.definitions:
            if d.name in names and (d.name in self._now.seen or d.name in self._now.failed):
                self._derived(d, taken)

    def _suffices(self) -> None:
        """The steps that are told alone, the others emptied, make the same outcome."""
        spots = [(r["at"], r["at"]) for r in self._reasons if "at" in r]
        spots += [(r["window"][0], r["window"][1]) for r in self._reasons if "window" in r]
        kept = [s.seen if s is self._now or any(a <= at <= b for a, b in spots) else {} for s, at in self._places()]
        self.seen["shorter"] += {} in kept
        assert not truths(self._prop.formula, [(s.time, s.seen) for s in self._steps], self._prop.time)[-1], self
        alone = [(s.time, signals) for s, signals in zip(self._steps, kept, strict=True)]
        assert not truths(self._prop.formula, alone, self._prop.time)[-1], f"the told steps are no reason: {self}"

    def _places(self) -> Iterator[tuple[Seen, int]]:
        """The steps, and how reasons give each."""
        return ((s, s.time if self._prop.time == "seconds" else n) for n, s in enumerate(self._steps, 1))

    def _reason(self, reason: Mapping[str, Any]) -> None:
        step = self._event(reason)
        for failing in reason.get("failing", ()):
            self._failing(failing, step if step is not None or "at" in reason else self._now)
        try:
            formula = parse_formula(reason["formula"], self._prop.time)
        except FormulaError:
            return  # a variable stands for a value that was not seen
        decides = _deciding(formula, holds=reason["holds"])
        if decides is not None and step is not None:
            part, holds = decides
            assert self._at(part)[self._steps.index(step)] is holds, f"{reason['formula']} at {step.number}: {self}"
            self.seen["parts"] += 1
        beside = reason["text"].startswith("(") and (  # as seen from one of several at a time, or from several
            self._prop.time == "seconds" or re.search(r"in steps [\d–]+(, | and )", reason["text"])  # noqa: RUF001
        )
        if decides is None and isinstance(formula, tree.Once | tree.Historically) and not beside:
            for (_, at), holds in zip(self._places(), self._at(formula.operand), strict=True):
                within = "window" in reason and reason["window"][0] <= at <= reason["window"][1]
                assert not within or holds is not isinstance(formula, tree.Once), f"{reason}: {self}"
            self.seen["windows"] += "window" in reason

    def _at(self, part: Formula) -> list[bool]:
        return truths(part, [(s.time, s.seen) for s in self._steps], self._prop.time)

    def _event(self, reason: Mapping[str, Any]) -> Seen | None:
        """The step that a reason names, which has what is told of it."""
        event = reason.get("event")
        if event is None:
            return None
        step = self._steps[event["step"] - 1] if "step" in event else self._now
        told, derived = event["signals"], {d.name for d in self._reference.definitions}
        assert told.items() <= step.seen.items(), f"{event}: {self}"
        assert step.seen.keys() - told.keys() <= derived, f"{event}: {self}"  # those that nothing reads there
        assert event["stream"] == step.stream, self
        assert reason.get("at") in (None, step.time if self._prop.time == "seconds" else step.number), self
        self.seen["events"] += 1
        return step

    def _failing(self, failing: Mapping[str, Any], step: Seen | None) -> None:
        """That a constraint fails at a step, as it is told; None where that is not known any more."""
        name, value, wanted = failing["signal"], failing["value"], failing["wanted"]
        if step is None:
            return
        if "missing" in failing:
            assert name not in step.seen, f"{failing}: {self}"
            assert (failing["missing"] == "failed") is (name in step.failed), f"{failing}: {self}"
        else:
            assert step.seen.get(name) == value, f"{failing}: {self}"
            assert wanted is None or not meets(Constraint(name, failing["op"], wanted), value), f"{failing}: {self}"
        self.seen["failing"] += 1

    def _derived(self, d: Definition, taken: Sequence[Seen]) -> None:
        """What is told of a derived signal behind the steps that were taken."""
        value = "failed" if d.name in self._now.failed else json.dumps(self._now.seen[d.name])
        text = self._told.text or ""
        found = re.search(rf"(?:^|; ){d.name} {re.escape(value)}(?: for [^:;]*?)?(?P<rest>(?:: | since |$|;).*)", text)
        assert found is not None, f"{d.name} is {value}: {self}"
        self.seen["derived"] += 1
        rest = re.split("; d[0-9]", found["rest"])[0]
        if d.name in self._now.failed:
            return
        if d.table is not None:
            self._machine(d, taken, rest)
            return
        last = re.search(r"last at step (\d+)", rest)
        if last and d.op != "expression":
            assert self._samples(d, taken)[-1:] == [int(last[1])], f"{d.name} {last[0]}: {self}"
            self.seen["last"] += 1
        many = re.match(r": (\d+) of ", rest)
        if many and d.op == "count":
            assert int(many[1]) == self._now.seen[d.name], self

    def _samples(self, d: Definition, taken: Sequence[Seen]) -> list[int]:
        """The numbers of the steps that add to a derived signal, of the key of the step that is explained."""
        own = [step for step in taken if self._reference._sample(d, step) is not None]
        return [step.number for step in own if all(_same(step, self._now, by) for by in d.by)]

    def _machine(self, d: Definition, taken: Sequence[Seen], rest: str) -> None:
        """Since when a machine is where it is, and where it was before."""
        if d.forget is not None or len(d.by) > 1 or d.op != "states":
            return
        states: list[object] = []
        for n in range(len(taken) + 1):
            probe = Seen(self._now.time, n, "", {}, (), dict(self._now.seen), set(self._now.failed))
            states.append(self._reference._value(d, taken[:n], probe, self._now.time, n, 0))
        changed = [n for n in range(len(taken), 0, -1) if states[n] != states[n - 1]]
        wanted = [*changed, 0, 0]
        since, event = re.search(r"since step (\d+)", rest), re.search(r"; .+? at step (\d+); allowed: ", rest)
        if self._now.seen[d.name] == "error" and changed:
            assert event is not None, self
            assert int(event[1]) == wanted[0], f"{d.name}: {self}"
            wanted = wanted[1:]
        if since is not None:
            # while it may be in several states, these may change, and are no value before and after that
            moved = "may be any of" in rest and int(since[1]) > wanted[0]
            assert moved or int(since[1]) == wanted[0], f"{d.name}: {self}"
        self.seen["machines"] += since is not None or event is not None


def _walk(reasons: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    for reason in reasons:
        yield reason
        yield from _walk(reason.get("reasons", ()))


def _deciding(formula: Formula, *, holds: bool) -> tuple[Formula, bool] | None:
    """The part of a formula that decides it at a step which is told, and whether it holds there; None for a window."""
    match formula:
        case tree.Atom():
            return formula, holds
        case tree.Once(operand) if holds:
            return operand, True
        case tree.Historically(operand) if not holds:
            return operand, False
        case tree.Since(_, right) if holds:
            return right, True
        case tree.Pre(operand):
            return operand, holds
    return None


def _same(one: Seen, other: Seen, name: str) -> bool:
    """Whether two steps have the same value of a signal."""
    mine: Scalar | None = one.seen.get(name)
    theirs: Scalar | None = other.seen.get(name)
    return mine is not None and mine == theirs and isinstance(mine, bool) is isinstance(theirs, bool)


def check_owed(prop: Property, told: Explanation, about: Sequence[AboutRecord], times: Sequence[int]) -> Counter[str]:
    """What is claimed of obligations that were not answered; `times` are those of all steps."""
    found, seen = obligation(prop.formula), Counter[str]()
    assert found is not None
    assert told.why
    for reason in told.why["reasons"]:
        shown = f"{prop.text} ({prop.time}): {reason}\n{times}"
        asked = re.match(r"asked for at step (\d+) ", reason["text"])
        assert asked is not None, shown
        start = int(asked[1])
        assert start in [each["step"] for each in about], shown
        if not isinstance(found.goal, tree.Eventually | tree.Until) or found.goal.bound.upper is None:
            continue
        lower, upper = found.goal.bound.lower, found.goal.bound.upper
        many = re.search(r"at none of (\d+) steps? until", reason["text"])
        if many:
            assert int(many[1]) == sum(time <= times[start - 1] + upper for time in times[start - 1 :]), shown
            seen["owed in time"] += 1
        spread = re.search(r"at none of steps? (\d+)(?:–(\d+))?", reason["text"])  # noqa: RUF001 -- a range
        if spread:
            assert (int(spread[1]), int(spread[2] or spread[1])) == (start + lower, start + upper), shown
            seen["owed in steps"] += 1
    return seen
