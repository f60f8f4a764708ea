"""Stamps of a publisher that fall back, as where its machine's clock is set back: time does not stand still."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.session import Session
from oracle_server.core.spec import SECOND
from oracle_server.core.verdicts import Judged
from tests.core.sessions import A, B, Feed, open_session, outcomes, prop
from tests.core.test_ticks import native

MS = 10**6
NOW = 1_000 * SECOND
BACK = 1800 * SECOND
HEARD = prop("p", '{topic: "/a"} -> once[:50ms] {topic: "/b"}', time="seconds")


def heard(*, apart: int = 0, **ordering: Any) -> tuple[Session, Feed, list[Judged]]:
    """A session that has heard of /b and /a by one clock, which is `apart` (ns) from that of arrivals."""
    ordering = {"max_delay": 20 * MS, "max_skew": SECOND, **ordering}
    session = open_session([HEARD], attach={"m": [A, B]}, maker=native, **ordering)
    feed = Feed(session)
    judged = feed(B, NOW - apart, arrived=NOW) + feed(A, NOW - apart + MS, arrived=NOW + MS)
    return session, feed, judged


def test_a_clock_that_is_set_back_does_not_let_time_stand_still() -> None:
    session, feed, judged = heard()
    for ago in (100, 200):
        at = NOW + ago * MS
        judged += feed(A, at - BACK, arrived=at)
    judged += feed(B, NOW + 300 * MS - BACK, arrived=NOW + 300 * MS)
    judged += feed(A, NOW + 310 * MS - BACK, arrived=NOW + 310 * MS)
    judged = [j for j in judged + session.finish(NOW + SECOND) if j.step.event.monitor]  # without ticks
    assert outcomes(judged) == ["currently_true"] * 2 + ["currently_false"] * 2 + ["currently_true"] * 2
    assert [(j.step.skewed, j.step.late, j.verdicts[0].degraded) for j in judged] == [(False, False, False)] * 2 + [
        (True, False, True)
    ] * 4
    assert [j.step.time - NOW for j in judged][2:] == [100 * MS, 200 * MS, 300 * MS, 310 * MS]


def test_who_is_in_step_again_is_ordered_by_its_stamps_again_and_others_always_were() -> None:
    session, feed, _ = heard()
    feed(A, NOW + 100 * MS - BACK, arrived=NOW + 100 * MS)
    judged = feed(B, NOW + 105 * MS, arrived=NOW + 106 * MS) + feed(A, NOW + 110 * MS, arrived=NOW + 112 * MS)
    judged += session.finish(NOW + SECOND)
    assert [j.step.time - NOW for j in judged][-2:] == [105 * MS, 110 * MS]
    assert not any(verdict.degraded for j in judged[-2:] for verdict in j.verdicts)


@pytest.mark.parametrize(
    ("back", "ordering"),
    [
        (SECOND, {}),
        (BACK, {"max_skew": 2 * BACK}),
        (BACK, {"late": "skip"}),
        (2 * SECOND, {"late": "revise", "horizon": 3 * SECOND}),
    ],
)
def test_what_may_be_late_by_a_delay_stays_late(back: int, ordering: dict[str, Any]) -> None:
    session, feed, _ = heard(**ordering)
    judged = feed(A, NOW + 30 * MS - back, arrived=NOW + 30 * MS) + session.finish(NOW + SECOND)
    assert [(j.step.late, j.step.skewed) for j in judged if j.step.event.seq == 3] == [(True, False)]


def test_arrivals_tell_no_time_where_stamps_were_never_in_step_with_them() -> None:
    """As in a recording of a simulation: one that is old would set the present decades ahead."""
    session, feed, _ = heard(apart=900 * SECOND)
    judged = feed(A, NOW - 905 * SECOND, arrived=NOW + SECOND) + session.finish(NOW + SECOND)
    assert [(j.step.late, j.step.skewed) for j in judged if j.step.event.seq == 3] == [(True, False)]
