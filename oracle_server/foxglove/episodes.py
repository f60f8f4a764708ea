"""Episodes as lines of a log: violations of a property that follow each other closely are one."""

from __future__ import annotations

from dataclasses import dataclass

from oracle_server.core.naming import moment, retraction_text
from oracle_server.core.records import VerdictRecord
from oracle_server.core.spec import SECOND
from oracle_server.core.units import counted
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.foxglove.channels import Message, log_message

_GAP = SECOND
"""A violation that begins later than that after the end of the last one begins another episode."""
_INFO, _WARNING, _ERROR = 2, 3, 4


@dataclass(slots=True)
class _Open:
    """An episode that may go on: since when, until when as far as is known, and whether it is negative at present."""

    since: int
    last: int
    count: int = 0
    negative: bool = False


class Episodes:
    """Takes the records of a session as they were judged, those between at which nothing changed left out."""

    def __init__(self, prefix: str = "") -> None:
        """Begin with none; `prefix` goes before the channel's name."""
        self._prefix = prefix
        self._open: dict[tuple[str, str], _Open] = {}

    def take(self, record: VerdictRecord) -> list[Message]:
        """What is told of a record: an episode that begins with it, and those that have ended."""
        told = self.passed(record["stamp"], record["judged"])
        key = record["property"], record["order"]
        if record["violation"] and key not in self._open:
            self._open[key] = _Open(record["stamp"], record["stamp"])
            level = _ERROR if record["outcome"] == "false" else _WARNING
            why = record["explanation"]
            text = f"{record['property']} does not hold" if why is None else why["text"]
            told.append(log_message(level, _name(record), text, record["judged"], record["stamp"], self._prefix))
        episode = self._open.get(key)
        if episode is not None:
            if episode.negative or record["violation"]:
                episode.last = max(episode.last, record["stamp"])
            episode.count += record["violation"]
            episode.negative = record["outcome"] in NEGATIVE
        return told

    def passed(self, stamp: int, judged: int) -> list[Message]:
        """The ends of episodes that are over when a step of this stamp is judged."""
        if not self._open:
            return []
        over = [key for key, e in self._open.items() if not e.negative and stamp - e.last > _GAP]
        return [self._ended(*key, judged) for key in over]

    def revised(self, record: VerdictRecord) -> list[Message]:
        """What is told of a revision: that a violation was found, or does not stand."""
        text, level, why = "", _INFO, record["explanation"]
        if record.get("retracted"):
            text = retraction_text(record)
        elif record["violation"]:
            text, level = "" if why is None else why["text"], _WARNING
        at = record["judged"], record["stamp"]
        return [log_message(level, _name(record), text, *at, self._prefix)] if text else []

    def _ended(self, name: str, order: str, judged: int) -> Message:
        episode = self._open.pop((name, order))
        seconds = (episode.last - episode.since) / SECOND
        text = f"{name}: ended at {moment(episode.last)}; {counted(episode.count, 'violation')} in {seconds:.3f} s"
        name = name if order == "publication" else f"{name} (arrival)"
        return log_message(_INFO, name, text, judged, episode.last, self._prefix)


def _name(record: VerdictRecord) -> str:
    """A property, and its order where that is not the one of publication."""
    return record["property"] if record["order"] == "publication" else f"{record['property']} (arrival)"
