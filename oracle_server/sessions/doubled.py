"""Messages that several monitors of a session hear of one publisher: each of them is judged as often."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice

from oracle_server.sessions.live import LiveSession

_EVERYWHERE = re.compile("[0-9a-f]{32,}")
"""A publisher's number on DDS, which is no other's anywhere; the name of a node may be another robot's, too."""
_FEW = 10
"""Monitors of a stream that are compared: whoever asks for a session's state does not wait for more."""
_MOST = 100
"""Publishers of each of them that are."""


def doubled(session: LiveSession) -> dict[str, list[str]]:
    """What is to be said of the properties that read such streams, by their ids.

    Not of streams of which something is held: each monitor has that of a shared topic for itself.
    """
    spec, readers = session.spec, session.core.plan.readers
    told: dict[str, list[str]] = {}
    for stream in spec.streams:
        monitors = session.core.buffer.heard(stream.key, _FEW)
        if stream.hold or len(monitors) < 2:
            continue
        for first, second in islice(_pairs(monitors), 1):
            text = (
                f"{first} and {second} hear one publisher of {stream.key}, whose messages are judged twice: "
                "give each robot's adapter its --namespace, or have one alone observe it"
            )
            for index in readers.get(stream.key.name, ()):
                told.setdefault(spec.properties[index].id, []).append(text)
    return told


def _pairs(monitors: Sequence[tuple[str, Iterable[str]]]) -> Iterator[tuple[str, str]]:
    """Each two monitors that hear one publisher."""
    by_publisher: dict[str, str] = {}
    for monitor, publishers in monitors:
        for publisher in islice(publishers, _MOST):
            other = by_publisher.setdefault(publisher, monitor)
            if other != monitor and _EVERYWHERE.fullmatch(publisher):
                yield other, monitor
