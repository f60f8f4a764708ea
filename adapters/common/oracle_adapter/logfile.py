"""An offline monitor's log: what a link would have sent, in a file that `replay` takes."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import threading
import time
from typing import TYPE_CHECKING, Any, Callable, Dict, Mapping, Optional

from oracle_adapter.errors import LinkError
from oracle_adapter.jsonvalues import dumps
from oracle_adapter.notices import Attached
from oracle_adapter.stats import Stats

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from oracle_adapter.exchange import Stamp, State
    from oracle_adapter.link import Details

MAX_APART = 10**9
"""Nanoseconds for which the time of lines may wait for the wall clock."""


class LogFile:
    """Replaces a `Link` where there is no oracle: it writes events, and denies nothing.

    Streams are observed only, whatever the spec would have filtered; services and actions stay
    behind their proxies, since there is no other way to observe them.
    """

    def __init__(
        self,
        path: str,
        described: Mapping[str, Any],
        monitor: str,
        on_state: Callable[[State, str], None],
        on_error: Callable[[LinkError], None],
    ) -> None:
        """Append to `path`; `described` is what `oracle-server streams SPEC` prints.

        Raises ValueError where one of them can't be used.
        """
        try:
            streams = tuple({**s, "action": "log"} for s in described["streams"])
            spec, digest = str(described["spec"]), str(described["spec_digest"])
        except (KeyError, TypeError):
            raise ValueError("--streams: is not what `oracle-server streams SPEC` prints") from None
        self.attached = Attached(monitor, path, spec, digest, streams, {})
        self._monitor, self._on_state, self._on_error = monitor, on_state, on_error
        self._lock = threading.Lock()
        self._stats = Stats()
        self._seq = self._arrived = self._ticks = 0
        self._missed = 0  # events that could not be written since the last line
        self._unread = 0  # events that could not be read, which no line tells yet
        self._back = False
        try:
            self._cut = _is_cut(path)  # within a line
            # without a buffer: what the disk does not take would wait there, and be written later
            self._file = open(path, "ab", buffering=0, opener=_at_once)  # noqa: SIM115 - `close` closes it
        except OSError as error:
            unread = error.errno == errno.ENXIO
            reason = "it is a FIFO that nobody reads yet" if unread else error.strerror
            raise ValueError(f"--log {path}: can't be written: {reason}") from None

    def start(self) -> None:
        """Report that the log takes events."""
        self._on_state("attached", f"attached to the log {self.attached.session}")

    def wait_attached(self, timeout: Optional[float] = None) -> Attached:  # noqa: ARG002
        """The streams to observe."""
        return self.attached

    def send(
        self, stream: str, kind: str, stamp: Stamp, data: Any, **more: Unpack[Details]
    ) -> bool:
        """Write an event as a line, at once; False where that failed.

        The first failure in succession is reported, and the next line tells how many were lost.
        """
        line: Dict[str, Any] = {"stream": stream, "kind": kind, "monitor": self._monitor}
        line.update(_given(**more))
        with self._lock:
            published = stamp() if callable(stamp) else stamp
            self._seq += 1
            line.update(seq=self._seq, stamp=published, arrived=self._arrive(), data=data)
            if self._back:
                line["back"] = True
            lost = (more.get("lost") or 0) + self._missed + self._unread
            if lost:
                line["lost"] = lost
            try:
                self._append(dumps(line))
            except (OSError, ValueError) as error:
                first = not self._missed
                self._missed, self._unread = lost + 1, 0
                self._stats.lost += 1
                reason = getattr(error, "strerror", None) or str(error)
            else:
                self._missed, self._unread, self._back = 0, 0, False
                self._stats.sent += 1
                return True
        if first:
            self._on_error(LinkError("lost", f"the log can't be written: {reason}"))
        return False

    def _arrive(self) -> int:
        """The time of a line (ns), which never goes back, and stands still for a second at most."""
        ticks, before = time.monotonic_ns(), self._ticks
        self._ticks = ticks
        wall = time.time_ns()
        if wall < self._arrived - MAX_APART:  # the clock was set back: all would arrive at one time
            self._arrived += ticks - before
        self._arrived = max(self._arrived, wall)
        return self._arrived

    def lost(self, count: int) -> bool:
        """Have the next line tell that so many could not be read before; True where it has to."""
        with self._lock:
            self._unread += count
            return self._missed + self._unread > 0

    def clock(self, stamps: object) -> None:
        """Ignore it: only the server's ordering needs clocks."""

    def renew(self, stamps: object) -> None:  # noqa: ARG002
        """Mark the next event: simulated time went back, where a link would begin a new session."""
        with self._lock:
            self._back = self._seq > 0

    def report(self, stream: str, kind: str, **facts: object) -> None:
        """Ignore it: there is no server to show it."""

    def stats(self) -> Stats:
        """The counters, as they are now."""
        with self._lock:
            return Stats(sent=self._stats.sent, lost=self._stats.lost)

    def close(self, timeout: float = 5.0) -> bool:  # noqa: ARG002
        """Close the file."""
        with self._lock, contextlib.suppress(OSError):  # a failed write was reported
            self._file.close()
        return True

    def _append(self, line: str) -> None:
        """Write a line, or nothing of it where the disk is full. Raises OSError and ValueError."""
        number, text = self._file.fileno(), f"{line}\n".encode()
        text = b"\n" + text if self._cut else text
        before, written = os.fstat(number).st_size, 0
        try:
            while written < len(text):
                written += os.write(number, text[written:])
        except OSError:
            if written and os.fstat(number).st_size == before + written:  # nobody else has written
                with contextlib.suppress(OSError):
                    os.ftruncate(number, before)
                    written = 0
            self._cut = self._cut or written > 0
            raise
        self._cut = False


def _at_once(path: str, flags: int) -> int:
    """Open a file; a FIFO that nobody reads is not waited for. Raises OSError."""
    number = os.open(path, flags | os.O_NONBLOCK, 0o666)
    os.set_blocking(number, True)
    return number


def _is_cut(path: str) -> bool:
    """Whether a log ends within a line, as where the power failed."""
    if not os.path.isfile(path) or not os.path.getsize(path):
        return False
    with open(path, "rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read() != b"\n"


def _given(**details: Unpack[Details]) -> Dict[str, Any]:
    return {name: value for name, value in details.items() if value is not None}


def open_log(
    path: str,
    streams: Optional[str],
    monitor: str,
    on_state: Callable[[State, str], None],
    on_error: Callable[[LinkError], None],
) -> LogFile:
    """The log at `path` of the streams that the file `streams` describes. Raises ValueError."""
    if not streams:
        raise ValueError(
            "--log needs --streams FILE; make it by `oracle-server streams SPEC > FILE`"
        )
    try:
        with open(streams, encoding="utf-8") as file:
            described = json.load(file)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ValueError(f"--streams {streams}: can't be read: {reason}") from None
    return LogFile(path, described, monitor, on_state, on_error)
