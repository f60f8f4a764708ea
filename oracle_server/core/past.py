"""The last steps as one property observed them, for explanations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from oracle_server.core.atoms import Matches
from oracle_server.core.events import Signals


class Seen(NamedTuple):
    """A step as explanations name it, and what formulas saw of it.

    `stamp` is its time of publication in nanoseconds, `failed` are the signals that could not be computed, `unread`
    derived ones that were not worked out, since no formula reads them there. `event` names the event; it is empty for a
    tick, which has no `number`.
    """

    number: int | None
    stamp: int
    event: str
    signals: Signals
    failed: Collection[str]
    unread: Collection[str] = ()


@dataclass(frozen=True, slots=True)
class Past:
    """The last steps, of which the present one is the last.

    `times` are theirs, in nanoseconds; `matches` returns the matches of the formula's atoms at an index of `times`, and
    `seen` the step, where that is known.
    `effort` is what one explanation may cost: ten for each value of a part of the formula that is computed.
    """

    times: Sequence[int]
    matches: Callable[[int], Matches]
    effort: int = 10_000
    seen: Callable[[int], Seen] | None = None
    spent: Callable[[int], None] | None = None
    """Is told what the explanation has cost, a formula's parts included."""
    noun: str = "step"
    """What the present number of a step is called: its `place`, where some have got another one than their number."""


NO_PAST = Past((), lambda _: ())
