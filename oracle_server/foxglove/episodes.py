"""Episodes as lines of a log: one where it begins, one where it is over."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable
from typing import TYPE_CHECKING

from oracle_server.core.episode import EpisodeRecord
from oracle_server.core.naming import moment
from oracle_server.core.records import VerdictRecord
from oracle_server.core.spec import GAP, SECOND
from oracle_server.core.units import counted
from oracle_server.foxglove.channels import Message, log_message

if TYPE_CHECKING:  # what writes a file needs no sessions
    from oracle_server.sessions.beginnings import Told

_INFO, _WARNING, _ERROR = 2, 3, 4


def told_message(told: Told, time: int, prefix: str = "") -> Message | None:
    """The line of what became of an episode, known at a time (ns); None where nothing is to be told of it."""
    episode = told.record
    if told.moved:
        return None
    if told.event == "begun":
        return _begun(episode, time, prefix)
    if told.event == "ended":
        return _ended(episode, time, prefix)
    at = moment(episode["began"])
    text = f"retracted: {episode['property']} was not violated at {at}: what came late shows it"
    return log_message(_INFO, _name(episode), text, time, episode["began"], prefix)


class Recorded:
    """The episodes of a recorded session, each told where the records have come to it."""

    def __init__(self, episodes: Iterable[EpisodeRecord], gap: int = GAP) -> None:
        """`gap` (ns) is that of the spec: an episode that is not open is over once that has passed."""
        self._gap = gap
        self._coming: defaultdict[tuple[str, str], deque[EpisodeRecord]] = defaultdict(deque)
        self._ending: list[EpisodeRecord] = []
        for episode in sorted(episodes, key=lambda each: each["first"]):
            self._coming[episode["property"], episode["order"]].append(episode)

    def take(self, record: VerdictRecord) -> list[Message]:
        """What is told of a verdict's record: the episodes that begin with it, and those that have ended."""
        told = self.passed(record["stamp"], record["judged"])
        coming = self._coming[record["property"], record["order"]]
        while coming and coming[0]["first"] <= record["n"]:
            episode = coming.popleft()
            told.append(_begun(episode, record["judged"]))
            self._ending += [] if episode["open"] else [episode]
        return told

    def passed(self, stamp: int, judged: int) -> list[Message]:
        """The ends of episodes that are over when a step of this stamp is judged."""
        return self._end([e for e in self._ending if stamp - (e["until"] or 0) >= self._gap], judged)

    def rest(self, judged: int) -> list[Message]:
        """The ends of the others: they are over with their session."""
        return self._end(self._ending, judged)

    def _end(self, over: list[EpisodeRecord], judged: int) -> list[Message]:
        if over:
            self._ending = [each for each in self._ending if each not in over]
        return [_ended(each, judged) for each in over]


def _begun(episode: EpisodeRecord, time: int, prefix: str = "") -> Message:
    level = _ERROR if episode["final"] else _WARNING
    text = episode["explanation"] or f"{episode['property']} does not hold"
    return log_message(level, _name(episode), text, time, episode["began"], prefix)


def _ended(episode: EpisodeRecord, time: int, prefix: str = "") -> Message:
    until = episode["until"] or episode["began"]
    lasted, count = (until - episode["began"]) / SECOND, counted(episode["count"], "violation")
    text = f"{episode['property']}: ended at {moment(until)}; {count} in {lasted:.3f} s"
    return log_message(_INFO, _name(episode), text, time, until, prefix)


def _name(episode: EpisodeRecord) -> str:
    """A property, and its order where that is not the one of publication."""
    name = episode["property"]
    return name if episode["order"] == "publication" else f"{name} (arrival)"
