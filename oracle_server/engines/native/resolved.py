"""Obligations that were decided, and those of them that are told: very many may be decided false at once."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import nsmallest

import msgspec

from oracle_server.core.owing import MOST_TOLD
from oracle_server.core.records import EventRecord
from oracle_server.engines.native.keys import Key, texts_of
from oracle_server.engines.native.waiting import FALSE, Moment


class Decided(msgspec.Struct, frozen=True, gc=False):
    """An obligation that was decided: the step that triggered it, for which values, what came of it, and its event.

    `value` is `TRUE`, `FALSE` or `LOST`.
    """

    start: Moment
    key: Key
    value: int
    event: EventRecord


def count(decided: Sequence[Decided], value: int) -> int:
    """How many were decided so."""
    return sum([each.value == value for each in decided])


def first_failed(decided: Sequence[Decided]) -> list[Decided]:
    """Those that were decided false, the oldest first: all of the oldest steps, until they are as many as are told."""
    failed = [each for each in decided if each.value == FALSE]
    if len(failed) > MOST_TOLD:  # to order all by their values would take longer than to decide them
        *_, newest = nsmallest(MOST_TOLD, [each.start for each in failed])
        failed = [each for each in failed if each.start <= newest]
    return sorted(failed, key=lambda each: (each.start, texts_of(each.key)))[:MOST_TOLD]
