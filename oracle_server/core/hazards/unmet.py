"""Atoms that name what a spec does not have: streams and signals that are misspelt, or that belong elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import Atom, Constraint
from oracle_server.core.kinds import ACTION, GROUPS, KINDS, NAMING, NOUNS
from oracle_server.core.nearest import either, listed, nearest
from oracle_server.core.plan import can_meet, has_reserved, naming, not_signals, reserved_of
from oracle_server.core.spec import Spec, StreamSpec


def unmet(spec: Spec) -> Iterator[SpecProblem]:
    """Atoms that no event of a spec can meet."""
    held = spec.kept
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms:
            reason = why_never(atom, spec, held)
            if reason:
                yield SpecProblem(("properties", i, "formula"), f"formula of '{prop.id}': {reason}", atom.at)


def idle_exclusions(spec: Spec) -> Iterator[SpecProblem]:
    """Atoms that exclude a stream or a kind which there is not, and so exclude nothing: misspelt names.

    Asked of new specs alone: sessions with such ones are in histories.
    """
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms:
            reason = _excludes_nothing(atom, spec)
            if reason:
                yield SpecProblem(("properties", i, "formula"), f"formula of '{prop.id}': {reason}", atom.at)
    for definition in spec.derive:
        reasons = (_excludes_nothing(atom, spec) for atom in definition.atoms)
        for reason in dict.fromkeys(filter(None, reasons)):
            yield SpecProblem(("derive", definition.name), f"derived signal '{definition.name}': {reason}")


def _excludes_nothing(atom: Atom, spec: Spec) -> str | None:
    for constraint in atom.constraints:
        if constraint.op == "!=":
            reason = _unknown_stream(constraint, spec)
            if reason is None and constraint.key == "kind" and isinstance(constraint.value, str):
                reason = _unknown_kind(constraint.value, _kinds(spec))
            if reason is not None:
                return reason
    return None


def _unknown_stream(constraint: Constraint, spec: Spec) -> str | None:
    """What is wrong with a constraint that names a stream, where the spec has none of that name."""
    group, name = constraint.key, constraint.value
    if group not in naming(spec) or not isinstance(name, str):
        return None
    names = sorted({s.name for s in spec.streams if s.traits.group == group})
    return None if name in names else _no_stream(group, name, names, spec)


def has_signal(stream: StreamSpec, key: str, held: frozenset[str]) -> bool:
    """Whether an event of a stream can have a signal; `held` are those that some stream holds."""
    if key in reserved_of(stream):
        return has_reserved(stream, key)
    if key in held:
        return True
    return key not in not_signals(stream) if stream.signals is None else key in stream.signals


def why_never(atom: Atom, spec: Spec, held: frozenset[str]) -> str | None:
    """Why an atom can never hold, since it names something that the spec does not have; None where it can."""
    for constraint in atom.constraints:
        reason = _unknown_stream(constraint, spec) if constraint.op == "==" else None
        if reason is not None:
            return reason
    streams = [s for s in spec.streams if can_meet(s, atom)]
    if not streams:
        return f"no event of this spec can meet {render_atom(atom)}{_contradiction(atom.constraints, spec)}"
    for constraint in atom.constraints:
        if not any(has_signal(s, constraint.key, held) for s in streams):
            if isinstance(constraint.value, str) and constraint.value in spec.names:
                group = next(s.traits.group for s in spec.streams if s.name == constraint.value)
                return f"unknown signal '{constraint.key}'; for the stream write `{group}: \"{constraint.value}\"`"
            return _no_signal(constraint.key, streams, held, spec)
    if not any(all(has_signal(s, c.key, held) for c in atom.constraints) for s in streams):
        mend = "name those of other streams under `hold` there, so that they keep their values"
        return f"no event of this spec has all the signals of {render_atom(atom)}; {mend}"
    return None


def _no_stream(group: str, name: str, names: Sequence[str], spec: Spec) -> str:
    known = listed(names) or "none"
    other = next((s.traits.group for s in spec.streams if s.name == name), None)
    if other:
        return f"{group} '{name}' is no stream of this spec; it is a {other}: write `{other}: \"{name}\"`"
    hint = nearest(name, names)
    return f"{group} '{name}' is no stream of this spec; {f'{hint} ' if hint else ''}it has {known}"


def _no_signal(key: str, streams: Sequence[StreamSpec], held: frozenset[str], spec: Spec) -> str:
    where = listed(str(s.key) for s in streams)
    verb = "declares" if len(streams) == 1 else "declare"
    declared = sorted({name for s in streams for name in s.signals or ()} | held)
    owners = [str(s.key) for s in spec.streams if key in (s.signals or {})]
    if owners:
        have = "has" if len(owners) == 1 else "have"
        mend = f"{' and '.join(owners)} {have} it: name it under `hold` there, so that it keeps its value"
        return f"unknown signal '{key}'; {where} {verb} {listed(declared) or 'none'}; {mend}"
    hint = nearest(key, declared)
    return f"unknown signal '{key}'; {f'{hint} ' if hint else ''}{where} {verb} {listed(declared) or 'none'}"


def _kinds(spec: Spec, groups: Sequence[str] = ()) -> list[str]:
    """The kinds of events of these groups; where there are none, of those that the spec has, topics and services."""
    known = groups or {"topic", "service", *(stream.traits.group for stream in spec.streams)}
    return [kind for kind, traits in KINDS.items() if traits.group in known]


def _unknown_kind(kind: str, kinds: Sequence[str]) -> str | None:
    if any(kind == known and traits.group for known, traits in KINDS.items()):
        return None
    hint = nearest(kind, kinds)
    return f"there is no kind '{kind}'; {f'{hint} the' if hint else 'the'} kinds are {', '.join(kinds)}"


def _contradiction(constraints: Sequence[Constraint], spec: Spec) -> str:
    """Which reserved signals do not go together."""
    wanted = {c.key: c.value for c in constraints if c.key in NAMING and c.op == "=="}
    groups = [group for group in GROUPS if group in wanted]
    kinds = _kinds(spec, groups)
    kind = wanted.get("kind")
    unknown = _unknown_kind(kind, kinds) if isinstance(kind, str) else None
    if unknown is not None:
        return f": {unknown}"
    if len(groups) > 1:
        words = [NOUNS[group] for group in groups]
        return f": an event is of {' or of '.join(words)}, and never of both"
    for group in groups if isinstance(kind, str) else ():
        if kind not in kinds:
            return f": events of {NOUNS[group]} are of kind {either([f'`{k}`' for k in kinds])}"
        if group == ACTION and not any(s.kind == kind for s in spec.streams if s.name == wanted[group]):
            return f": the spec does not observe this kind of {wanted[group]}; write `{kind}: {{}}` at it"
    if "call" in wanted:
        having = [traits.noun for traits in KINDS.values() if traits.has_call]
        return f": only {', '.join(having[:-1])} and {having[-1]} have a `call`"
    return ""
