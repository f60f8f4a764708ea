"""Patterns that ask for something at the beginning of a session alone, where that is hardly meant."""

from __future__ import annotations

import re
from collections.abc import Iterator

from oracle_server.core.errors import SpecProblem
from oracle_server.core.spec import Spec

_NONE_WITHIN = re.compile(
    r"(?:forall\s*\[[^]]*\]\s*\.\s*)*no\b.*\bwithin\b\s*(?P<time>[^)}\]]+)", re.IGNORECASE | re.DOTALL
)


def at_the_beginning(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of `no B within d` without a scope: its time counts from the begin of the session."""
    for i, prop in enumerate(spec.properties):
        found = _NONE_WITHIN.fullmatch(prop.text.strip()) if prop.says == "pattern" else None
        if found is None:
            continue
        time = found["time"].strip()
        message = (
            f"pattern of '{prop.id}': it says nothing of what comes later than {time} after the first event of the "
            "session, from which `within` counts where there is no scope; write `after E: no … within` for the time "
            "after an E, leave `within` out for all times, or write `globally:` before it where the "
            "beginning is meant"
        )
        yield SpecProblem(("properties", i, "formula"), message, severity="warning")
