"""What stands, in the columns of steps; revisions, as rows among them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.records import ExplanationRecord
from oracle_server.core.revisions import Change, Standing
from oracle_server.core.verdicts import Outcome
from oracle_server.history.letters import LETTERS, letters
from oracle_server.history.records import PropertyStands, Restated, StoredRevision, StoredStep

BYPASSED = "2"
"""The digit of a property that is degraded only while a stream is bypassed."""
_OUTCOMES = {letter: outcome for outcome, letter in LETTERS.items()}

RESTATE = """
UPDATE steps SET
    standing = new.standing,
    standing_degraded = new.degraded,
    standing_explanations = new.explanations,
    explanations = coalesce(steps.explanations, iif(new.explanations IS NULL, NULL, '{}')),
    revised = json_patch(coalesce(steps.revised, '{}'), new.revised)
FROM (
    SELECT json_extract(value, '$[0]') AS session, json_extract(value, '$[1]') AS position,
        json_extract(value, '$[2]') AS standing, json_extract(value, '$[3]') AS degraded,
        json_extract(value, '$[4]') AS explanations, json_extract(value, '$[5]') AS revised
    FROM json_each(?)
) AS new
WHERE steps.session = new.session AND steps.position = new.position
"""
"""Keep what stands of some steps, which are given as one text: the writer needs the interpreter once a statement.

The session is given with each, so that SQLite looks each step up: were it one value, all of its steps would be read for
each.
"""

_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.decode


def restate_text(session: int, restated: Mapping[int, Restated]) -> str:
    """The one value of `RESTATE`."""
    rows = [(session, p, *_standing(r.standing), whys_text(r.revised)) for p, r in restated.items()]
    return _encode(rows).decode()


def standing_columns(stored: StoredStep) -> tuple[str | None, ...]:
    """The columns `standing` to `revision` of a row."""
    standing = (None, None, None) if stored.standing is None else _standing(stored.standing)
    revised = whys_text(stored.revised) if stored.revised else None
    return (*standing, revised, None if stored.revision is None else _revision_text(stored.revision))


def standing_of(row: Mapping[str, Any]) -> Standing:
    """What stands of a step that was revised, by its row."""
    return Standing(
        outcomes_of(row["standing"]), degraded_of(row["standing_degraded"]), whys_of(row["standing_explanations"])
    )


def revised_of(text: str) -> dict[int, int]:
    """The numbers of the revisions by which a step stands as it does."""
    return {int(i): n for i, n in _decode(text).items()}


def revision_of(text: str) -> StoredRevision:
    """A revision of its text."""
    kept = _decode(text)
    return StoredRevision(
        tuple([None if change is None else _change(change) for change in kept["changes"]]),
        tuple([_event(*event) for event in kept["because"]]),
        kept["causes"],
    )


def outcomes_of(text: str) -> tuple[Outcome | None, ...]:
    """The same, back."""
    return tuple([_OUTCOMES[letter] for letter in text])


def stands(
    names: Sequence[str], outcomes: str, degraded: str, pending: str | None, told: str | None
) -> list[PropertyStands]:
    """How each property stands, by the columns of a step, and its violations as JSON."""
    counts = _decode(pending) if pending else {}
    violations = _decode(told) if told else {}
    found = []
    for i, (name, outcome, digit) in enumerate(zip(names, outcomes_of(outcomes), degraded, strict=True)):
        count, first = violations.get(name, (0, None))
        of_it = outcome or Outcome.UNKNOWN, count, first, counts.get(str(i))
        found.append(PropertyStands(name, *of_it, degraded=digit == "1", bypassed=digit == BYPASSED))
    return found


def degraded_of(text: str) -> tuple[bool, ...]:
    """Which are degraded, of a text with a digit each."""
    return tuple([digit != "0" for digit in text])


def whys_text(values: Mapping[int, object]) -> str:
    """Values by the property's place as JSON."""
    return _encode({str(i): value for i, value in values.items()}).decode()


def whys_of(text: str | None) -> dict[int, ExplanationRecord]:
    """Explanations by the property's place, back."""
    return {} if text is None else {int(i): why for i, why in _decode(text).items()}


def _standing(standing: Standing) -> tuple[str, str, str | None]:
    degraded = "".join(["1" if it else "0" for it in standing.degraded])
    return letters(standing.outcomes), degraded, whys_text(standing.explanations) if standing.explanations else None


def _revision_text(revision: StoredRevision) -> str:
    because = [(e.monitor, e.seq, *e.stream, e.stamp, e.arrived) for e in revision.because]
    return _encode({"changes": revision.changes, "because": because, "causes": revision.causes}).decode()


def _change(change: dict[str, Any]) -> Change:
    outcome = change.pop("outcome")
    return Change(**change, outcome=None if outcome is None else Outcome(outcome))


def _event(monitor: str, seq: int, *where: Any) -> Event:
    stream, kind, stamp, arrived = where
    return Event(StreamKey(stream, kind), monitor, seq, stamp, arrived, None)
