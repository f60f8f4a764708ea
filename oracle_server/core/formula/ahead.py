"""Obligations: `forall[x]. φ -> ψ`, where ψ waits for what comes: their parts, and what is refused of them."""

from __future__ import annotations

from dataclasses import dataclass

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import Formula, children, walk

Ahead = tree.Next | tree.Eventually | tree.Always | tree.Until
Path = tuple[int, ...]
"""Where a part stands: which child of which child of the whole."""
WORDS: dict[type[Formula], str] = {
    tree.Next: "next",
    tree.Eventually: "eventually",
    tree.Always: "always",
    tree.Until: "until",
}
PAST: dict[type[Formula], str] = {
    tree.Pre: "pre",
    tree.Once: "once",
    tree.Historically: "historically",
    tree.Since: "since",
}
_NEGATED = {
    tree.Next: "write `next not …`",
    tree.Eventually: "write `always not …`",
    tree.Always: "write `eventually not …`",
    tree.Until: "write what must come instead, as in `always not …`",
}


@dataclass(frozen=True, slots=True)
class Obligation:
    """At each step at which `trigger` holds for some values of the variables, `goal` is asked for, for these.

    Without a trigger it is asked for at every step. The paths are where both stand in the whole formula.
    """

    variables: tuple[str, ...]
    trigger: Formula | None
    goal: Formula
    trigger_path: Path
    goal_path: Path


def looks_ahead(formula: Formula) -> bool:
    """Whether a formula waits for what comes."""
    return any(isinstance(node, Ahead) for node in walk(formula))


def obligation(formula: Formula) -> Obligation | None:
    """A formula as an obligation, None where it only looks back."""
    if not looks_ahead(formula):
        return None
    variables, body, path = list[str](), formula, tuple[int, ...]()
    while isinstance(body, tree.Forall):
        variables.append(body.variable)
        body, path = body.body, (*path, 0)
    if isinstance(body, tree.Implies) and looks_ahead(body.right):
        return Obligation(tuple(variables), body.left, body.right, (*path, 0), (*path, 1))
    return Obligation(tuple(variables), None, body, path, path)


def unbounded(goal: Formula) -> Ahead | None:
    """A part of what is awaited that time never decides, None where there is none."""
    bounded = (tree.Eventually, tree.Always, tree.Until)
    return next((node for node in walk(goal) if isinstance(node, bounded) and node.bound.upper is None), None)


def can_fail(goal: Formula) -> bool:  # noqa: PLR0911 -- a case a node
    """Whether what is awaited can be decided false while the session goes on."""
    match goal:
        case tree.Eventually(_, bound):
            return bound.upper is not None
        case tree.Always(operand):
            return can_fail(operand)
        case tree.Until(left, _, bound):
            return bound.upper is not None or can_fail(left)
        case tree.And(left, right):
            return can_fail(left) or can_fail(right)
        case tree.Or(left, right):
            return can_fail(left) and can_fail(right)
        case tree.Implies(_, right) if looks_ahead(goal):
            return can_fail(right)
        case _:
            return True


def check_ahead(formula: Formula) -> None:
    """Refuse what is no obligation although it waits for what comes. Raises `FormulaError` with its place."""
    found = obligation(formula)
    if found is None:
        _check_limits(formula, "")
        return
    if found.trigger is not None:
        _check_limits(found.trigger, "")
    _check_limits(found.goal, None)
    if found.trigger is not None and (early := first_ahead(found.trigger)) is not None:
        _refuse(
            early,
            f"`{_word(early)}` stands before `->`: what is asked for at a step must be known there; write it behind "
            "`->`, as in `{goal} -> eventually[:60] {done}`",
        )
    _check_goal(found.goal)
    endless = unbounded(found.goal)
    if found.trigger is None and endless is not None:
        word = _word(endless)
        mend = (
            "a property is asked for at every step anyway, so leave `always` out"
            if word == "always"
            else f"`{word}[:60] …` has one"
        )
        _refuse(
            endless,
            f"without an upper bound each step would wait for ever: {mend}; write `… -> {word} …` for what begins "
            "with an event",
        )
    needed = needs(found.trigger) if found.trigger is not None else frozenset()
    for name in found.variables:
        if name not in needed:
            first = first_ahead(found.goal)
            assert first is not None  # noqa: S101 -- else it is no obligation
            where = "no `->` binds it" if found.trigger is None else "what stands before `->` can hold without it"
            _refuse(
                first,
                f"for which values of '{name}' is `{_word(first)}` asked for? {where}; write an atom that has it, as "
                f"in `forall[{name}]. {{goal: *{name}}} -> {_word(first)} …`",
            )


def needs(formula: Formula) -> frozenset[str]:  # noqa: PLR0911 -- a case a node
    """The free variables for whose values that no event has had a formula can't hold."""
    match formula:
        case tree.Atom():
            return frozenset(name for _, name in formula.refs)
        case tree.And(left, right):
            return needs(left) | needs(right)
        case tree.Or(left, right):
            return needs(left) & needs(right)
        case tree.Implies(left, right):
            return excludes(left) & needs(right)
        case tree.Not(operand):
            return excludes(operand)
        case tree.Pre(operand) | tree.Once(operand):
            return needs(operand)
        case tree.Historically(operand, bound):
            return needs(operand) if not bound.lower else frozenset()
        case tree.Since(_, right):
            return needs(right)
        case tree.Exists(variable, body) | tree.Forall(variable, body):
            return needs(body) - {variable}
        case _:
            return frozenset()


def excludes(formula: Formula) -> frozenset[str]:  # noqa: PLR0911 -- a case a node
    """The free variables for whose values that no event has had a formula always holds."""
    match formula:
        case tree.Not(operand):
            return needs(operand)
        case tree.And(left, right):
            return excludes(left) & excludes(right)
        case tree.Or(left, right):
            return excludes(left) | excludes(right)
        case tree.Implies(left, right):
            return needs(left) | excludes(right)
        case tree.Historically(operand):
            return excludes(operand)
        case tree.Once(operand, bound) | tree.Since(_, operand, bound):
            return excludes(operand) if not bound.lower else frozenset()
        case tree.Exists(variable, body) | tree.Forall(variable, body):
            return excludes(body) - {variable}
        case _:
            return frozenset()


def _check_goal(node: Formula) -> None:
    """Refuse what is awaited where it is not put together of `and`, `or` and what waits."""
    if not looks_ahead(node):
        return
    match node:
        case tree.Not(operand):
            below = first_ahead(operand)
            assert below is not None  # noqa: S101 -- it looks ahead
            _refuse(below, f"`not` can't stand before what waits for what comes: {_NEGATED[type(below)]}")
        case tree.Pre() | tree.Once() | tree.Historically() | tree.Since():
            below = first_ahead(node)
            assert below is not None  # noqa: S101 -- it looks ahead
            past, word = PAST[type(node)], _word(below)
            _refuse(
                below,
                f"`{word}` stands within `{past}`, which is judged when it is asked, and not later; write it the "
                f"other way round, `{past}` within `{word}`, as in `{{a}} -> eventually[:5] once[:2] {{b}}`",
            )
        case tree.Exists(variable) | tree.Forall(variable):
            word = "exists" if isinstance(node, tree.Exists) else "forall"
            raise FormulaError(
                f"`{word}[{variable}].` stands around what waits for what comes; `forall[{variable}].` stands in front "
                f"of all of it, as in `forall[{variable}]. {{goal: *{variable}}} -> eventually[:60] "
                f"{{done: *{variable}}}`",
                *node.at,
            )
        case tree.Implies(left, _) if (early := first_ahead(left)) is not None:
            _refuse(early, f"`{_word(early)}` stands before `->`; what is asked for there must be known at once")
        case _:
            for child in children(node):
                _check_goal(child)


def _check_limits(node: Formula, within: str | None) -> None:
    """Refuse comparisons with variables but in what is awaited, `within` None, at the step that is judged.

    What looks back from there began before the variable had its value.
    """
    if isinstance(node, tree.Atom):
        if within is not None and node.limits:
            _refuse_limit(node, within)
        return
    if within is None and isinstance(node, tree.Exists | tree.Forall):
        within = "exists" if isinstance(node, tree.Exists) else "forall"
    for child in children(node):
        _check_limits(child, PAST.get(type(node)) if within is None else within)


def _refuse_limit(atom: tree.Atom, within: str) -> None:
    limit = atom.limits[0]
    assert isinstance(limit.value, tree.Limit)  # noqa: S101 -- these are all such
    key, op, name = limit.key, limit.op, limit.value.name
    example = f"forall[{name}]. {{limit: *{name}}} -> always[:5] {{{key} {op} *{name}}}"
    if within in ("exists", "forall"):
        reason = f"stands within `{within}`; compare outside of it"
    elif within:
        reason = (
            f"stands within `{within}`, which looks back to before '{name}' had its value; compare at the step itself"
        )
    else:
        reason = "compares with a variable, as only what waits for what comes can, behind the `->` that binds it"
    other = (
        f"; bind its value too where nothing is awaited, as `{{{key}: *y}} and *y {op} *{name}`; two signals of one "
        f"event compare as `{{{key} {op} limit}}`"
    )
    raise FormulaError(f"`{key} {op} *{name}` {reason}, as in `{example}`{other}", *atom.at)


def first_ahead(formula: Formula) -> Ahead | None:
    """The first part that waits for what comes."""
    return next((node for node in walk(formula) if isinstance(node, Ahead)), None)


def _word(node: Ahead) -> str:
    return WORDS[type(node)]


def _refuse(node: Ahead, message: str) -> None:
    raise FormulaError(message, *node.at)
