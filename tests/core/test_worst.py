"""The gravest of outcomes: what is not known is never hidden by what holds."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from oracle_server.core.verdicts import NEGATIVE, Outcome, worst

outcomes = st.lists(st.sampled_from(Outcome), min_size=1)


@given(outcomes, outcomes)
def test_more_properties_make_it_no_better(some: list[Outcome], more: list[Outcome]) -> None:
    assert worst([worst(some), worst(more)]) == worst(some + more) == worst(more + some)
    assert worst(some) in some


@given(outcomes)
def test_a_negative_one_shows_and_an_unknown_one_is_not_read_as_satisfied(some: list[Outcome]) -> None:
    assert (worst(some) in NEGATIVE) == any(o in NEGATIVE for o in some)
    assert worst([Outcome.UNKNOWN, *some]) not in {Outcome.TRUE, Outcome.CURRENTLY_TRUE}


def test_nothing_judged_is_unknown() -> None:
    assert worst([]) is Outcome.UNKNOWN
