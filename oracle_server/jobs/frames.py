"""What a process that judges a recording is told, and tells."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from oracle_server.core.events import By, Order
from oracle_server.core.revisions import Revision
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.records import Document, StoredStep


class Task(msgspec.Struct):
    """The path of a recording, the text of the spec that it is judged by, and folders with types.

    Paths are bytes, by `os.fsencode`: they need not be text. `most_bytes` is the size that no file may exceed which is
    unpacked beside it.
    """

    recording: bytes
    name: str
    spec: str
    types: Sequence[bytes]
    most_bytes: int


class Started(msgspec.Struct, tag=True):
    """There is something to judge; `begun` is when its session began (ns), in its own time."""

    by: By | None
    decides: Order
    begun: int | None


class Rows(msgspec.Struct, tag=True):
    """What was judged next, and what it does with episodes."""

    steps: list[StoredStep]
    revisions: list[Revision]
    episodes: list[StoredEpisode]


class Progress(msgspec.Struct, tag=True):
    """How far it has got: events that were judged, and what was read of a size, in the same unit."""

    events: int
    read: int
    size: int
    state: Document | None = None


class Ended(msgspec.Struct, tag=True):
    """All of it was judged: how its session stands, and what a replay concludes."""

    state: Document
    conclusion: Document


class Failed(msgspec.Struct, tag=True):
    """It can't be judged, or not any further: why, and how its session stands by the rows that were told.

    `state` is None where nothing was judged, or not all of it could be told.
    """

    error: str
    state: Document | None = None


Frame = Started | Rows | Progress | Ended | Failed
