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
        gone = [n for n in definition.needed if n in found or not (n in derived or may_have(n))]
        if gone and (len(definition.by) < 2 or len(gone) == len(definition.needed)):
            found[definition.name] = tuple(dict.fromkeys(root for name in gone for root in found.get(name, (name,))))
    return found
