"""What one property saw of the last steps, for explanations to go back to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from oracle_server.core.atoms import Matches


@dataclass(frozen=True, slots=True)
class Past:
    """The last steps, the present one among them as the last.

    `times` are theirs, in nanoseconds; `matches` tells what the formula's atoms made of the one at a place of `times`.
    `effort` is what one explanation may cost: ten for a value of a part of the formula that is worked out.
    """

    times: Sequence[int]
    matches: Callable[[int], Matches]
    effort: int = 10_000


NO_PAST = Past((), lambda _: ())
