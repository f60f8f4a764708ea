"""Parts of formulas that can never hold, or never fail, whatever the messages say: hardly what was meant.

The most common one: a step is one event of one stream, so that a signal of another stream is absent unless it is held.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.ahead import looks_ahead, obligation
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render, render_atom
from oracle_server.core.formula.tree import (
    FALSE,
    TRUE,
    Always,
    And,
    Any,
    Atom,
    Bound,
    Constraint,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Position,
    Since,
    Until,
    atoms,
    children,
    lasted,
    walk,
)
from oracle_server.core.hazards.decided import decided, followed
from oracle_server.core.hazards.excluded import excluded
from oracle_server.core.hazards.instants import Instants, Occurrence, Row
from oracle_server.core.hazards.joins import unjoined
from oracle_server.core.hazards.lacks import quoted, whose
from oracle_server.core.hazards.misfits import Doubt, counted, misfits
from oracle_server.core.hazards.places import Place, names_of, places
from oracle_server.core.hazards.spanned import spanned
from oracle_server.core.hazards.unrelated import unrelated
from oracle_server.core.hazards.worlds import Effort, Truth
from oracle_server.core.kinds import NAMING
from oracle_server.core.spec import Property, Spec
from oracle_server.core.typed import StreamTypes

_Keeping = Historically | Since | Always | Until
"""What asks that something holds at step after step."""


def vacuous(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about formulas of a spec without errors, whose messages have these types."""
    where: dict[Time, list[Place]] = {}
    effort = Effort()
    for i, prop in enumerate(spec.properties):
        if prop.time not in where:
            where[prop.time] = places(spec, prop.time, types)
        for doubt in dict.fromkeys(doubts(prop, where[prop.time], effort)):
            what = "formula of" if doubt.key == "formula" else "property"
            within = doubt.at if doubt.key == "formula" else None
            message = f"{what} '{prop.id}': {doubt.message}"
            yield SpecProblem(("properties", i, doubt.key), message, within, severity="warning", kind="vacuous")


def doubts(prop: Property, where: Sequence[Place], effort: Effort) -> Iterator[Doubt]:
    """What is doubtful in a property's formula at some places, each with a claim that holds for all messages."""
    if prop.external or prop.numeric:
        return
    known, lenient = (Instants(prop.formula, where, value, effort) for value in (Place.value, _lenient))
    seen = _Seen(prop, where, known, lenient, effort)
    yield from seen.doubts()


@dataclass(slots=True)
class _Seen:
    """A formula as it is judged at some places; `lenient` knows nothing of atoms that other streams could meet."""

    prop: Property
    places: Sequence[Place]
    known: Instants
    lenient: Instants
    effort: Effort

    def doubts(self) -> Iterator[Doubt]:
        quantified = list(decided(self.prop.formula, self.known, self.places))
        yield from quantified
        within = {id(node) for doubt in quantified for node in walk(doubt.part)}
        told = {id(doubt.part) for doubt in quantified}
        """The parts, by identity, of which something was told, and the instants in which something was found."""
        fitting = set[int]()
        """Instants in which nothing was found but atoms that every value meets."""
        foreign: dict[int, Doubt] = {}
        """Atoms that ask for another stream: the last one of each instant, where nothing else is wrong there."""
        nowhere: list[Occurrence[Atom]] = []
        for occurrence in self.known.occurrences():
            instant = id(occurrence.instant)
            nowhere += [] if any(occurrence.counts) else [occurrence]
            found = [*misfits(occurrence.part, self.places)] or [*self._lacking(occurrence)]
            (told if any(doubt.claim != "met" for doubt in found) else fitting).update([instant] if found else [])
            yield from found
            if id(occurrence.part) not in within:
                for doubt in self._foreign(occurrence):
                    always = followed(occurrence.instant, occurrence.part, self.known, self.places, self.prop.time)
                    foreign[instant] = always or doubt
        together = [(id(o.instant), doubt) for o in self._together(nowhere, told) for doubt in self._lacking(o)]
        told |= {instant for instant, _ in together}
        yield from (doubt for _, doubt in together)
        yield from (doubt for instant, doubt in foreign.items() if instant not in told)
        lacking = set(told)
        told |= foreign.keys()
        asking = _Keeping if self.prop.says == "formula" else Historically | Since  # a sentence's `until` is its scope
        for node in reversed(list(walk(self.prop.formula))):  # the innermost first, which alone is told
            if isinstance(node, asking) and not lacking & {id(part) for part in walk(_kept(node))}:
                ended = list(self._ended(node))
                lacking |= {id(doubt.part) for doubt in ended}
                yield from ended
        told |= lacking
        for keeping in self.known.keeping():
            parts = {id(part) for part in walk(keeping.part)}
            if id(keeping.instant) not in told | within and not parts & told:
                elsewhere = list(self._elsewhere(keeping))
                told |= {id(part) for doubt in elsewhere for part in (doubt.part, keeping.instant)}
                yield from elsewhere
        if not told | fitting:
            yield from self._partial()
        yield from self._unending()
        yield from unjoined(self.prop.formula, self.places)
        yield from unrelated(self.prop.formula, self.places)
        settled = list(self._settled(told))
        yield from settled
        yield from _apart_from(settled, spanned(self.prop.formula, self.places))
        if self.prop.says == "formula":
            yield from excluded(
                self.prop.formula, self.known, self.places, self.prop.time, self.effort, told | fitting | within
            )
        yield from self._unused_guards()

    def _idle(self, occurrence: Occurrence[Formula]) -> list[Place]:
        """The streams at whose events a part could decide something, and never holds; none where it holds at some."""
        row = self.known.row(occurrence.part)
        if any(counts and value is not False for counts, value in zip(occurrence.counts, row, strict=True)):
            return []
        return [p for p, counts in zip(self.places, occurrence.counts, strict=True) if counts and p.stream]

    def _lacking(self, occurrence: Occurrence[Atom]) -> Iterator[Doubt]:
        """An atom that holds nowhere where it could decide anything, for want of signals."""
        atom = occurrence.part
        lacking = [p for p in self._idle(occurrence) if p.allows(atom) and p.lacks(atom)]
        if lacking:
            keys = sorted({key for p in lacking for key in p.lacks(atom)})
            why = whose(self.places, lacking, keys)
            message = f"`{render_atom(atom)}` never holds at an event of {names_of(lacking, 'or')}: {why}"
            yield Doubt("idle", atom, message, atom.at)

    def _together(self, nowhere: Sequence[Occurrence[Atom]], told: set[int]) -> Iterator[Occurrence[Atom]]:
        """Atoms that count nowhere alone, where they would together with others that lack their signals as well."""
        standing = {(id(o.instant), id(o.part)) for o in nowhere if id(o.instant) not in told}
        if standing:
            mended = Instants(self.prop.formula, self.places, _mended, self.effort)
            yield from (o for o in self.known.occurrences(mended) if (id(o.instant), id(o.part)) in standing)

    def _foreign(self, occurrence: Occurrence[Atom]) -> Iterator[Doubt]:
        """An atom that holds nowhere where it could decide anything, since it asks for another stream."""
        atom = occurrence.part
        foreign = [p for p in self._idle(occurrence) if not p.allows(atom)]
        if foreign:
            text = render_atom(atom)
            message = (
                f"`{text}` never holds at an event of {names_of(foreign, 'or')}, where alone it would matter: a step "
                f"is one event of one stream; write `once {text}` if it may have held before"
            )
            yield Doubt("idle", atom, message, atom.at)

    def _elsewhere(self, occurrence: Occurrence[Since | Historically]) -> Iterator[Doubt]:
        """What must have held at every step, and fails at each event at which it is asked, since that is another's."""
        node, kept = occurrence.part, _kept(occurrence.part)
        foreign = self._idle(occurrence)
        row = [(p, value) for p, value in zip(self.places, self.known.row(kept), strict=True) if p.stream]
        if not foreign or all(v is False for _, v in row) or any(v is not False for p, v in row if p in foreign):
            return
        lasts = lasted(node)
        if isinstance(node, Since) and lasts is None:
            others = [Atom((Constraint(p.stream.traits.group, "==", p.stream.name),)) for p in foreign if p.stream]
            wider = functools.reduce(Or, dict.fromkeys(others), kept)
            mend = f"`{render(wider, self.prop.time)}` for its left side if such an event may have come since"
        else:
            bound = Bound(0, lasts[1]) if lasts else node.bound
            mend = f"`{render(Once(kept, bound), self.prop.time)}` if it may have held before"
        whole, part = render(node, self.prop.time), render(kept, self.prop.time)
        message = (
            f"`{whole}` never holds at an event of {names_of(foreign, 'or')}, where alone it would matter: `{part}` "
            f"must hold at that event too, and is false there; write {mend}"
        )
        yield Doubt("idle", node, message, _place(node))

    def _ended(self, node: _Keeping) -> Iterator[Doubt]:
        """An operand that must hold at every step, and fails at every event of some stream for want of a signal."""
        operand = _kept(node)
        failing = self._lacking_at(operand)
        if not failing:
            return
        mended = _with_kept(node, Implies(_guard(operand, failing), operand))
        text, whole, mend = (render(each, self.prop.time) for each in (operand, node, mended))
        match node:
            case Historically(_, bound):
                after = "for ever after the first one" if bound == Bound() else "while one is within its bound"
                effect = f"`{whole}` is false {after}"
            case Always(_, bound):
                which = "each of them" if bound == Bound() else "each of them within its bound"
                effect = f"{which} breaks `{whole}`"
            case Until():
                effect = "each of them breaks the `until`, if its right side does not hold there"
            case Since():
                effect = f"each of them ends the `{'since' if lasted(node) is None else 'lasting'}`"
        why = _lack(operand, failing)
        message = f"`{text}` is false at every event of {names_of(failing)}{why}, so that {effect}; write `{mend}`"
        yield Doubt("false", operand, message, _place(operand), tuple(p.name for p in failing))

    def _unending(self) -> Iterator[Doubt]:
        """What ends a `since`, and begins it anew at each event at which it does."""
        for node in walk(self.prop.formula):
            if not (isinstance(node, Since) and isinstance(node.left, Not)) or node.bound.lower:
                continue
            last, first = node.left.operand, node.right
            again = Implies(last, first)
            row = Instants(again, self.places, Place.value, self.effort).row(again)
            if all(row) and any(value is not False for value in self.known.row(last)):
                one, other = (render(part, self.prop.time) for part in (last, first))
                message = (
                    f"`{one}` ends nothing, since `{other}` holds at each of its events too, and begins anew; "
                    f"{_begun_apart(one, other)}"
                )
                yield Doubt("idle", last, message, _place(last))

    def _partial(self) -> Iterator[Doubt]:
        """The whole formula, where it fails at every event of some streams for want of a signal."""
        formula = self.prop.formula
        failing = self._lacking_at(formula)
        guard = _guard(formula, failing) if failing else TRUE
        if guard != TRUE:
            mended = render(Implies(guard, formula), self.prop.time)
            message = (
                f"it is false at every event of {names_of(failing)}{_lack(formula, failing)}, and so is violated "
                f"there, whatever the messages say; write `{mended}`"
            )
            yield Doubt("false", formula, message, _place(formula), tuple(p.name for p in failing))

    def _lacking_at(self, operand: Formula) -> list[Place]:
        """Some streams, not all, at whose events an operand fails for want of a signal."""
        mendable = zip(self.places, self.known.row(operand), self.lenient.row(operand), strict=True)
        failing = [p for p, value, other in mendable if p.stream and value is False and other is not False]
        return [] if len(failing) == sum(p.stream is not None for p in self.places) else failing

    def _settled(self, told: set[int]) -> Iterator[Doubt]:
        """Instants that are known to hold, or to fail, wherever they are judged, if nothing in them says why."""
        for instant in self.known.operands():
            row = self.known.row(instant)
            value = row[0]
            if instant is not self.prop.formula and instant in (TRUE, FALSE):
                continue
            if value is None or any(v is not value for v in row):
                continue
            if not told & {id(node) for node in walk(instant)}:
                yield self._constant(instant, value)
            told.add(id(instant))

    def _unused_guards(self) -> Iterator[Doubt]:
        """Streams at whose events the property holds, so that it can deny none: not where it was negative before."""
        row = self._holding()
        if self.prop.latch or all(row):
            return
        for name in sorted(self.prop.guards):
            own = [
                (p, holds)
                for p, holds in zip(self.places, row, strict=True)
                if p.stream and p.stream.name == name and p.stream.action == "filter"
            ]
            if own and all(holds for _, holds in own):
                group = next(p.stream.traits.group for p, _ in own if p.stream)
                message = (
                    f"it guards {name}, and holds at every event of it, whatever the messages say, so that it denies "
                    f'none that can be judged; write what must hold there, as in `{{{group}: "{name}"}} -> …`, with '
                    "what other streams say under their `hold`"
                )
                yield Doubt("true", self.prop.formula, message, (1, 1), tuple(p.name for p, _ in own), "guards")

    def _holding(self) -> Row:
        """Where no event can break the property: of what waits for what comes, what it asks by `always`."""
        found = obligation(self.prop.formula)
        if found is None:
            return self.known.row(self.prop.formula)
        waiting = [node for node in walk(found.goal) if looks_ahead(node)]
        if any(isinstance(node, And) and not all(map(looks_ahead, children(node))) for node in waiting):
            return (None,) * len(self.places)  # a part is asked of the event that asks
        kept = [node.operand for node in waiting if isinstance(node, Always) and not looks_ahead(node.operand)]
        rows = zip(*map(self.known.row, kept), strict=True)
        return tuple(True if all(column) else None for column in rows)

    def _constant(self, instant: Formula, value: Truth) -> Doubt:
        what = "holds" if value else "fails"
        claim: Literal["true", "false"] = "true" if value else "false"
        if instant is self.prop.formula:
            more = "; it can never be violated" if value else "; write what must hold"
            if value and looks_ahead(instant):
                at_once = "where the event that asks is the answer, write a lower bound, as in `eventually[1:60] …`"
                more = f"{more}; {at_once}"
            message = f"it {what} at every event, whatever the messages say{more}"
        else:
            message = f"`{render(instant, self.prop.time)}` {what} at every event, whatever the messages say"
        read = Atom(tuple(c for atom in atoms(instant) for c in atom.constraints))
        message += counted(read, [p for p in self.places if p.again])
        return Doubt(claim, instant, message, _place(instant), tuple(p.name for p in self.places))


def _lenient(place: Place, atom: Atom) -> Truth:
    """What is known of an atom where it may be that it was meant for the events of another stream only."""
    value = place.value(atom)
    return None if value is False and not all(c.key in NAMING for c in atom.constraints) else value


def _mended(place: Place, atom: Atom) -> Truth:
    """What is known of an atom where it may be that the signals which it lacks are there."""
    return None if place.allows(atom) and place.lacks(atom) else place.value(atom)


def _guard(operand: Formula, failing: Sequence[Place]) -> Atom:
    """What says that the signals are there which an operand lacks: of its first atom that fails, with any value."""
    culprit = next(a for a in atoms(operand) if any(p.value(a) is False for p in failing))
    own = [c for c in culprit.constraints if c.key in NAMING]
    if any(not p.allows(culprit) for p in failing):
        return Atom(tuple(own))
    lacking = {key for p in failing for key in p.lacks(culprit)}
    keys = dict.fromkeys(c.key for c in culprit.constraints if c.key in lacking)
    return Atom((*own, *(Constraint(key, "==", Any.ANY) for key in keys)))


def _lack(operand: Formula, failing: Sequence[Place]) -> str:
    """Why an operand fails: the signals that the events of these places lack."""
    keys = sorted({key for a in atoms(operand) for p in failing if p.allows(a) for key in p.lacks(a)})
    verb = "has" if len(failing) == 1 else "have"
    return f", which {verb} no {quoted(keys, 'or')}" if keys else ""


def _kept(node: _Keeping) -> Formula:
    """The operand that must hold at every step."""
    return node.operand if isinstance(node, Historically | Always) else node.left


def _with_kept(node: _Keeping, kept: Formula) -> Formula:
    if isinstance(node, Historically | Always):
        return replace(node, operand=kept, written=None)
    return replace(node, left=kept, written=None)


def _apart_from(told: Sequence[Doubt], found: Iterator[Doubt]) -> Iterator[Doubt]:
    """What was found of parts of which nothing was told."""
    within = {id(node) for doubt in told for node in walk(doubt.part)}
    yield from (doubt for doubt in found if not within & {id(node) for node in walk(doubt.part)})


def _begun_apart(last: str, first: str) -> str:
    """How what begins is written so that what ends it does not begin it too."""
    if last == first:
        return (
            "say by its signals which of these events begins and which one ends, as by `{on: true}` and `{on: false}`"
        )
    return f"write what begins without them, as in `{first} and not {last}`"


def _place(node: Formula) -> Position:
    """Where a part of a formula begins, as far as its nodes have a place."""
    found: list[Position] = [n.at for n in walk(node) if isinstance(n, Atom | Exists | Forall)]
    return min(found, default=(1, 1))
