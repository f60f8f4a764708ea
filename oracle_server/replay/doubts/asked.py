"""Of which properties a recording asked nothing, where no silent stream and no missing signal is why."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.formula.tree import Atom
from oracle_server.core.judging.asked import Idle
from oracle_server.core.kinds import NAMING
from oracle_server.core.plan import can_meet
from oracle_server.core.session import Session
from oracle_server.core.spec import Spec
from oracle_server.replay.doubts.coverage import Coverage


def unasked(spec: Spec, session: Session | None, coverage: Coverage) -> Iterator[Idle]:
    """The properties of which nothing was asked, but where a silent stream or a missing signal is why."""
    judge = next(iter(session.judges.values()), None) if session else None
    for state in judge.properties if judge else ():
        why = state.watch.why() if state.watch else None
        if why is not None and not (why.atoms and all(_is_silent(spec, atom, coverage) for atom in why.atoms)):
            yield why


def _is_silent(spec: Spec, atom: Atom, coverage: Coverage) -> bool:
    """Whether none of the streams spoke that can meet an atom, or none had a signal that it reads."""
    if not any(coverage[s.key]["events"] for s in spec.streams if can_meet(s, atom)):
        return True
    counts = [[c["signals"][key] for c in coverage.values() if key in c["signals"]] for key in own(atom)]
    return any(found and not any(signal["present"] for signal in found) for found in counts)


def own(atom: Atom) -> frozenset[str]:
    """The signals that an atom reads, without those that say whose events it means."""
    return frozenset(c.key for c in atom.constraints) - NAMING
