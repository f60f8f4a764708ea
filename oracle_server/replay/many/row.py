"""A row of the table of results: what one property came to in one recording."""

from __future__ import annotations

from typing import Literal, NamedTuple

import msgspec

from oracle_server.core.events import By, Order

ErrorKind = Literal["recording", "run"]
"""Whether an error is of what the recording is, or only of this run, so that the next one tries again."""


class Row(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Columns in their order; times are nanoseconds since the epoch, digests SHA-256 in hexadecimal.

    What is not known, or was not counted, is None.
    """

    recording: str
    """The path, as it was given or found in a folder."""
    recording_digest: str | None
    recording_bytes: int | None
    spec: str
    """The spec's id."""
    spec_path: str
    spec_digest: str
    property: str
    order: Order | None = None
    """The order in which it was judged."""
    outcome: str | None = None
    """At the end of the recording."""
    violations: int | None = None
    episodes: int | None = None
    first_violation_step: int | None = None
    first_violation_at: int | None = None
    explanation: str | None = None
    """Why it was violated first."""
    robustness: float | None = None
    """The least that was measured, of what is finite."""
    unknown: int | None = None
    """Steps that could not be judged."""
    pending: int | None = None
    """Obligations that are open at the end."""
    unjudged: str | None = None
    """Why it was not judged; None where it was."""
    events: int | None = None
    late: int | None = None
    skipped: int | None = None
    """Late events that were not judged."""
    first_at: int | None = None
    """The earliest stamp of an event."""
    last_at: int | None = None
    notes: str | None = None
    """What else is to be known of the recording, on one line."""
    exit: int
    """The exit status of `replay` for this recording and spec."""
    error: str | None = None
    """Why the recording can't be used."""
    error_kind: ErrorKind | None = None
    by: By | None
    """The order that was asked for; None for the spec's own."""
    strict: bool
    types_digest: str | None
    """Of the folders of `--types`; None without."""
    version: str
    """Of the oracle-server that judged."""


COLUMNS = Row.__struct_fields__


class Key(NamedTuple):
    """By what a result is known again: who has an equal key has an equal result."""

    recording: str
    spec: str
    by: By | None
    strict: bool
    types: str | None
    version: str


def key_of(row: Row) -> Key | None:
    """The key of a row; None where it says nothing of what the recording holds."""
    if row.recording_digest is None or row.error_kind == "run":
        return None
    return Key(row.recording_digest, row.spec_digest, row.by, row.strict, row.types_digest, row.version)
