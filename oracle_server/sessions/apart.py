"""What is held for one monitor of an open session, and not seen at the events of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from oracle_server.core.events import StreamKey
from oracle_server.core.hazards.apart import unseen
from oracle_server.core.spec import Spec
from oracle_server.sessions.monitor import Monitor

_MOST = 3
"""Signals that are told of a property."""


class Apart:
    """Tells it by the streams that monitors observe, worked out anew only where these are others."""

    def __init__(self, spec: Spec, monitors: Mapping[str, Monitor]) -> None:
        """Look at those of `monitors` that are attached when it is asked."""
        self._spec, self._monitors = spec, monitors
        self._known: tuple[tuple[str, tuple[StreamKey, ...]], ...] = ()
        self._missing: Mapping[str, Sequence[str]] = {}

    @property
    def missing(self) -> Mapping[str, Sequence[str]]:
        """What each property does not see, in texts, by its id; nothing of the others."""
        there = tuple((name, m.streams) for name, m in self._monitors.items() if m.attached)
        if there != self._known:
            self._known = there
            self._missing = self._told()
        return self._missing

    def _told(self) -> Mapping[str, Sequence[str]]:
        monitors: dict[StreamKey, set[str]] = {}
        for name, streams in self._known:
            for key in streams:
                monitors.setdefault(key, set()).add(name)
        missing: dict[str, list[str]] = {}
        for found in unseen(self._spec, monitors):
            texts = missing.setdefault(found.property, [])
            if len(texts) == _MOST:
                continue
            mine, at, theirs = found.told(monitors)
            texts.append(
                f"{found.name} of {found.holder} is held for {mine} alone, and not seen at {at} of {theirs}: what is "
                f"held is of each monitor by itself; `{{last: {found.name}}}` under `derive` is of all"
            )
        return missing
