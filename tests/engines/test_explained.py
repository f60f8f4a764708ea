"""Every engine that can say why does so in a session, with what is remembered of the past."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.derived.definition import Definition
from oracle_server.core.engine import Answer, Explaining
from oracle_server.core.explanation import Why
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import SILENT, External, Ordering, Property, Spec, StreamSpec
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.table import ENGINES, make_engine
from tests.core.sessions import A, B, Feed, open_session, prop

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


def test_a_derived_signal_that_nothing_reads_at_a_step_is_not_said_to_be_absent() -> None:
    streams = (StreamSpec("/a", signals={"x": "msg.x"}), StreamSpec("/b", signals={}))
    count = Definition("n", "count", "", parse_formula("{topic: /b}"), over=5, counted=True)
    asked = prop("p", "{x: 1, n < 1}")
    spec = Spec("s", streams, (asked,), Ordering(by="arrival"), derive=(count,))
    session = Session(plan(spec), [[NativeEngine(asked.formula, asked.time)]])
    (row,) = Feed(session)(B, 1)
    why = row.verdicts[0].explanation
    assert why is not None
    assert why.text == "{x: 1, n < 1}: `x` is absent, at step 1 (0.000 s)", "of /b there was one, so that n is 1"
