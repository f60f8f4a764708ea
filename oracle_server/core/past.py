"""The last steps as one property observed them, for explanations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from oracle_server.core.atoms import Matches


@dataclass(frozen=True, slots=True)
class Past:
    """The last steps, of which the present one is the last.

    `times` are theirs, in nanoseconds; `matches` returns the matches of the formula's atoms at an index of `times`.
    `effort` is what one explanation may cost: ten for each value of a part of the formula that is computed.
    """

    times: Sequence[int]
    matches: Callable[[int], Matches]
    effort: int = 10_000


NO_PAST = Past((), lambda _: ())
