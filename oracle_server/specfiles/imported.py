"""Specs that `import` writes, and what is to be told of them."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from oracle_server.core.errors import Finding, OracleError, SpecError
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec


class NotWrittenError(OracleError):
    """A spec that can't be written where it is to be."""


@dataclass(frozen=True, slots=True)
class Imported:
    """What is left to be written, the streams at whose messages a module fails, and what `check` says of the spec."""

    todos: tuple[str, ...]
    failing: tuple[str, ...]
    findings: tuple[Finding, ...]
    judges: bool = True
    """Whether any property can say anything before what is left is written."""
    notes: tuple[str, ...] = ()
    """What else is to be known, which is nothing to be done for sure."""

    @property
    def refused(self) -> bool:
        """Whether `check` refuses the spec."""
        return any(finding.severity == "error" for finding in self.findings)

    @property
    def done(self) -> bool:
        """Whether nothing is left to be written, or to be looked at."""
        return not (self.todos or self.failing or self.findings)

    @property
    def summary(self) -> list[str]:
        """What is to be done, in a line each, or that the spec is sound."""
        errors = sum(finding.severity == "error" for finding in self.findings)
        warnings = len(self.findings) - errors
        told = []
        if errors:
            told.append(f"is refused by `check`: mend {_count(errors, 'place')} named above")
        if self.todos:
            told.append(f"is not done: {', '.join(self.todos)}: unknown until written, at the lines marked TODO")
        if self.failing:
            told.append(f"is unknown where a module fails, whatever the message has: {', '.join(self.failing)}")
        if not self.judges:
            told.append(
                "nothing was imported that judges anything: each property is unknown until its TODOs are written"
            )
        if not told:
            told.append(f"sound, {_count(warnings, 'warning')}" if warnings else "sound")
        return [*told, *self.notes]


def write_spec(text: str, out: Path | None, types: Types) -> tuple[Finding, ...]:
    """Write the text of a spec, or print it, and tell what `check` says of it. Raises `NotWrittenError`."""
    if out is None:
        sys.stdout.write(text)
    else:
        try:
            out.write_text(text, encoding="utf-8")
        except OSError as error:
            raise NotWrittenError(f"{out}: can't be written: {error.strerror}") from None
    try:
        return parse_spec(text, str(out or "the spec"), types=types).warnings
    except SpecError as error:
        return error.findings


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
