"""What atoms lack at some places: who has it, and how to make it last."""

from __future__ import annotations

from collections.abc import Sequence

from oracle_server.core.hazards.places import Place, names_of


def whose(places: Sequence[Place], lacking: Sequence[Place], keys: Sequence[str]) -> str:
    """Who, of all places, has signals that an atom lacks at some of them, and how to make them last.

    Of a derived signal it is what this is kept by, or computed of.
    """
    needed = sorted({name for key in keys for p in lacking if not p.has(key) for name in p.lack.get(key, (key,))})
    derived, named = [key for key in keys if key not in needed], quoted(needed)
    it, keeps = ("it", "it keeps its value") if len(needed) == 1 else ("them", "they keep their values")
    why = f"{quoted(derived)} {'needs' if len(derived) == 1 else 'need'} {named}" if derived else ""
    owners = [p for p in places if p.stream is not None and all(p.has(name) for name in needed)]
    if not owners:
        return f"{why or f'it has no {named}'}; name {it} under `hold` of their streams, so that {keeps}"
    verb = "has" if len(owners) == 1 else "have"
    hold = f"name {it} under `hold` of {names_of(owners, 'or')}, so that {keeps}"
    only = f"only {names_of(owners)} {verb} {named}; {hold}"
    return f"{why}, and {only}" if why else only


def quoted(keys: Sequence[str], last: str = "and") -> str:
    """Names of signals in a text."""
    listed = [f"`{key}`" for key in keys]
    return f" {last} ".join(filter(None, (", ".join(listed[:-1]), listed[-1])))
