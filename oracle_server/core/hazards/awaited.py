"""What `check` refuses or warns of in properties that wait for what comes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.ahead import WORDS, Ahead, Obligation, can_fail, looks_ahead, obligation, unbounded
from oracle_server.core.formula.breach import breach
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import TRUE, Always, And, Formula, Or, Until, atoms, lasted, walk
from oracle_server.core.hazards.lacks import quoted
from oracle_server.core.hazards.withholding import lasting, present, stays
from oracle_server.core.spec import Property, Spec


def awaited(spec: Spec) -> Iterator[SpecProblem]:
    """The problems of a spec's obligations."""
    for i, prop in enumerate(spec.properties):
        found = None if prop.external or prop.numeric else obligation(prop.formula)
        if found is None:
            yield from _idle(i, prop)
            continue
        yield from _guards(i, prop, found)
        anywhere = list(_trigger(i, prop, found))
        yield from anywhere or _asks_again(spec, i, prop, found)
        yield from _endless(i, prop, found)
        yield from _reaching(i, prop, found)


def waits(prop: Property) -> bool:
    """Whether a property waits for more than what is asked by `always`."""
    found = None if prop.external or prop.numeric else obligation(prop.formula)
    return found is not None and _beyond_always(found)


def _beyond_always(found: Obligation) -> bool:
    return any(isinstance(node, Ahead) and not isinstance(node, Always) for node in walk(found.goal))


def _idle(i: int, prop: Property) -> Iterator[SpecProblem]:
    if prop.at_end != "ignore":
        message = (
            f"`at_end` has no effect on '{prop.id}', which does not wait for what comes, so that nothing is open when "
            "the session ends; leave it out"
        )
        yield SpecProblem(("properties", i, "at_end"), message)


def _guards(i: int, prop: Property, found: Obligation) -> Iterator[SpecProblem]:
    """Guards of what is not decided by the guarded event itself, as a broken `always` is."""
    for name in sorted(prop.guards) if _beyond_always(found) else ():
        message = (
            f"'{prop.id}' waits for what comes, and can't decide about {name} when it passes; only what is asked by "
            "`always` can, as in `{stop} -> always[:5] {speed: 0}`; leave the guard out"
        )
        yield SpecProblem(("properties", i, "guards"), message)
    if prop.guards and not _beyond_always(found) and breach(found) is None:
        message = (
            f"'{prop.id}' guards by two `always`, joined by `or`: the event that breaks the second one is denied, and "
            "none that comes after it; guard by one of them alone, or by a formula that looks back, as in "
            "`{topic: /cmd, v > 0} -> not once[:5] {stop}`"
        )
        yield SpecProblem(("properties", i, "guards"), message, severity="warning")


def _trigger(i: int, prop: Property, found: Obligation) -> Iterator[SpecProblem]:
    """A trigger that may hold at any event, whatever that says."""
    if found.trigger is None or present(found.trigger, lambda atom: atom == TRUE) is False:
        return
    message = (
        f"property '{prop.id}': `{render(found.trigger, prop.time)}` can hold at any event, whatever that is, and asks "
        "anew at each step at which it does; write an atom of the event that asks, as in `{goal: *} and … -> …`"
    )
    yield SpecProblem(("properties", i, "formula"), message, severity="warning")


def _asks_again(spec: Spec, i: int, prop: Property, found: Obligation) -> Iterator[SpecProblem]:
    """A trigger that keeps its value, so that each message of any stream asks for another answer.

    Not of requirements, which say by `when` and `whenever` which of both is meant.
    """
    trigger, kept = found.trigger, lasting(spec) - {each.name for each in spec.derive if each.changes}
    if trigger is None or prop.says == "requirement" or len(spec.streams) == 1 or not _beyond_always(found):
        return
    if not stays(_of_now(trigger), kept):
        return
    names = sorted({c.key for atom in atoms(trigger) for c in atom.constraints} & kept)
    owner = next((stream.name for stream in spec.streams if stream.hold.intersection(names)), None)
    event = f"with its stream, as in `{{topic: {owner}, …}}`, or " if owner else ""
    message = (
        f"property '{prop.id}': `{render(trigger, prop.time)}` comes again at each message while it holds, since "
        f"{quoted(names)} {'keeps its value' if len(names) == 1 else 'keep their values'}, and asks for another answer "
        f"each time; write it {event}where it begins, as in `{{on}} and not pre {{on}}`"
    )
    yield SpecProblem(("properties", i, "formula"), message, severity="warning")


def _of_now(trigger: Formula) -> Formula:
    """A trigger without the `lasting` before what must hold now, too: once that has lasted, it comes again as well."""
    if isinstance(trigger, And):
        return And(_of_now(trigger.left), _of_now(trigger.right))
    since = lasted(trigger)
    return trigger if since is None else since[0]


def _endless(i: int, prop: Property, found: Obligation) -> Iterator[SpecProblem]:
    """What may come for ever, so that its absence is never a violation."""
    endless = unbounded(found.goal)
    if endless is None or prop.at_end == "violated" or can_fail(found.goal):
        return
    word = WORDS[type(endless)]
    what, mend = f"`{word}` without an upper bound", f"a bound, as in `{word}[:60] …`"
    if prop.says != "formula":
        what, mend = "what is awaited without `within`", "one, as in `within 60s`"
    message = (
        f"property '{prop.id}': {what} may be met for ever, so that the property is never violated; write {mend}, or "
        "`at_end: violated`"
    )
    yield SpecProblem(("properties", i, "formula"), message, endless.at, severity="warning", kind="vacuous")


def _reaching(i: int, prop: Property, found: Obligation) -> Iterator[SpecProblem]:
    """What stands behind a waiting operator, is not within it, and so is asked of the step that asks."""
    for node in walk(found.goal) if prop.says == "formula" else ():
        if not (isinstance(node, And | Or) and isinstance(node.left, Ahead)) or looks_ahead(node.right):
            continue
        waiting, joined = node.left, type(node)
        reached = waiting.right if isinstance(waiting, Until) else waiting.operand
        mend = _reaching_to(waiting, joined(reached, node.right))
        word, other = WORDS[type(waiting)], render(node.right, prop.time)
        message = (
            f"formula of '{prop.id}': `{word}` reaches no further than `{render(reached, prop.time)}`, so that "
            f"`{other}` is asked of the step that asks; write `{render(mend, prop.time)}`, or "
            f"`{other} {'and' if joined is And else 'or'} {word} …` where that is meant"
        )
        place = min((atom.at for atom in atoms(node.right)), default=None)
        yield SpecProblem(("properties", i, "formula"), message, place, severity="warning")


def _reaching_to(waiting: Ahead, reached: Formula) -> Formula:
    """What waits, with something else in the place of what comes."""
    if isinstance(waiting, Until):
        return replace(waiting, right=reached, written=None)
    return replace(waiting, operand=reached, written=None)
