"""Every engine that can say why does so in a session, with what is remembered of the past."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.engine import Answer, Explaining
from oracle_server.core.explanation import Why
from oracle_server.core.formula.names import Names
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.spec import SILENT, External, Property
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.table import ENGINES, make_engine
from tests.core.sessions import A, Feed, open_session, prop

RISES = "not (pre {v: 1} and {v: 2})"


def made(engine: Any) -> Property:
    if engine == "external":
        return Property("p", SILENT, "the oracle", engine=engine, external=External("ws://127.0.0.1:1"))
    text = "historically (v < 1.5)" if engine == "rtamt" else RISES
    return Property("p", ENGINES[engine].read(text, "steps", Names()), text, engine=engine)


@pytest.mark.parametrize("engine", ["native", "auto", "both", "external", "rtamt"])
def test_a_violation_says_why(engine: str) -> None:
    property_ = made(engine)
    session = open_session([property_], attach={}, maker=make_engine, by="arrival")
    state = session.judges["arrival"].properties[0]
    assert isinstance(state.engine, Explaining)
    feed, judged = Feed(session), []
    for value, said in ((1, Outcome.CURRENTLY_TRUE), (2, Outcome.CURRENTLY_FALSE)):
        judged = feed(A, value, {"v": value})
        for ask in session.take_asks():
            judged = session.resolve(ask, Answer(said, "said so"), value)
    why = judged[0].verdicts[0].explanation
    assert why
    assert why.text, "more than the formula"
    assert why.why
    assert why.why["reasons"]
    assert (state.unexplained, state.complaint) == (0, None)


def test_an_engine_that_fails_to_say_why_is_complained_of_and_judges_on() -> None:
    class Speechless(NativeEngine):
        def explain(self, past: Past = NO_PAST) -> Why:
            raise ZeroDivisionError

    session = open_session(
        [prop("p", "{v: 1}")], attach={}, maker=lambda p: Speechless(p.formula, p.time), by="arrival"
    )
    feed, state = Feed(session), session.judges["arrival"].properties[0]
    judged = [feed(A, n, {"v": v})[0].verdicts[0] for n, v in enumerate((2, 1, 2), 1)]
    assert [v.outcome.value for v in judged] == ["currently_false", "currently_true", "currently_false"]
    assert [v.explanation is not None for v in judged] == [True, False, True]
    assert state.complaint == "it could not say why 2 times; the last time: ZeroDivisionError"
