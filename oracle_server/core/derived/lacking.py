"""Where derived signals are absent, whatever came before: for want of their key, or of an operand."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from oracle_server.core.derived.definition import Definition


def lacking(definitions: Sequence[Definition], may_have: Callable[[str], bool]) -> dict[str, tuple[str, ...]]:
    """The derived signals that no step has which has none but the signals that it `may_have`: what each lacks there.

    What one lacks is never a derived signal itself. Their expressions must be sound.
    """
    found: dict[str, tuple[str, ...]] = {}
    derived = {definition.name for definition in definitions}
    for definition in definitions:
        lacks = [
            found.get(name) or (() if name in derived or may_have(name) else (name,)) for name in definition.needed
        ]
        if lacks and (all(lacks) if len(definition.by) > 1 else any(lacks)):
            found[definition.name] = tuple(dict.fromkeys(name for names in lacks for name in names))
    return found
