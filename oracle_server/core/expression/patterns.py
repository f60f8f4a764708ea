"""The patterns of `matches`, by RE2: a match takes time in proportion to the text, whatever the pattern is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import re2

from oracle_server.core.expression.cost import Frame, charge
from oracle_server.core.expression.stops import Failed
from oracle_server.core.expression.values import unfit

MAX_PATTERN = 256
"""Longest pattern, in characters."""
MAX_PROGRAM = 2_000
"""Most instructions of a compiled pattern."""
MAX_PATTERNS = 100
"""Most patterns of a spec."""
_MEMORY = 1 << 18
"""Most bytes that a pattern's automaton may take."""

_TOO_LARGE = f"the pattern is too large: its repetitions, written out, have more than {MAX_PROGRAM} parts"
_REASONS = {
    "bad repetition operator": "a repetition stands behind another one",
    "invalid character class": "there is no such class of characters",
    "invalid character class range": "a range of characters ends before it begins",
    "invalid escape sequence": "there is no such escape",
    "invalid perl operator": "there are no look-aheads and no look-behinds",
    "invalid repetition size": "a repetition counts at most to 1000, all that are nested together",
    "missing )": "a '(' is not closed",
    "missing ]": "a '[' is not closed",
    "missing argument to repetition operator": "nothing stands before a repetition",
    "no argument for repetition operator": "nothing stands before a repetition",
    "trailing \\": "nothing stands behind the last backslash",
    "trailing \\ at end of regexp": "nothing stands behind the last backslash",
    "unexpected )": "a ')' closes nothing",
}


@dataclass(frozen=True, slots=True)
class Pattern:
    """A compiled pattern; `weight` is what 16 characters of a text cost."""

    search: Callable[[str], Any]
    weight: int

    def found_in(self, text: Any, frame: Frame) -> bool:
        """Whether some part of a text matches."""
        if type(text) is not str:
            raise unfit("`matches` takes a text", text)
        charge(frame, len(text) * self.weight >> 4)
        try:
            return self.search(text) is not None
        except UnicodeEncodeError:
            raise Failed("the text has characters that are none", text) from None


def unreadable(pattern: str) -> str | None:
    """Why a pattern is refused, None where it is not."""
    if len(pattern) > MAX_PATTERN:
        return f"the pattern has {len(pattern)} characters; at most {MAX_PATTERN} are read"
    compiled = _compile(pattern)
    if isinstance(compiled, str):
        return compiled
    if compiled.weight > MAX_PROGRAM + 16:
        return _TOO_LARGE
    return None


def compile_pattern(pattern: str) -> Pattern:
    """A pattern that is readable."""
    compiled = _compile(pattern)
    assert isinstance(compiled, Pattern)  # noqa: S101 -- the parser has asked whether it is readable
    return compiled


@lru_cache(2 * MAX_PATTERNS)
def _compile(pattern: str) -> Pattern | str:
    options = re2.Options()
    options.max_mem, options.log_errors = _MEMORY, False
    try:
        compiled = re2.compile(pattern, options)
    except UnicodeEncodeError:
        return "the pattern has characters that are none"
    except re2.error as error:
        reason, _, found = bytes(*error.args).decode(errors="replace").partition(": ")
        if "too large" in reason:
            return _TOO_LARGE
        return f"the pattern can't be read: {_REASONS.get(reason, 'it is malformed')}{f', at {found}' if found else ''}"
    return Pattern(compiled.search, compiled.programsize + 16)
