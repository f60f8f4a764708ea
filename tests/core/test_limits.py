"""Comparisons with variables, as `{v > *x}`, in what an obligation waits for."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.session import Session
from oracle_server.core.spec import StreamSpec
from oracle_server.core.verdicts import Judged, record
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import A, B, Feed, open_session, prop

KEPT = "forall[x]. {limit: *x} -> always[:2] ({v: *} -> {v <= *x})"


def opened(formula: str, *streams: StreamSpec) -> Session:
    def native(property_: Any) -> NativeEngine:
        return NativeEngine(property_.formula, property_.time)

    given = streams or (StreamSpec("/a"), StreamSpec("/b"))
    return open_session([prop("p", formula)], attach={"m": [A, B]}, streams=given, maker=native, by="arrival")


def fed(session: Session, *data: dict[str, Any]) -> list[dict[str, Any]]:
    feed = Feed(session)
    judged: list[Judged] = [j for n, each in enumerate(data, 1) for j in feed(A, n, each)]
    return [dict(record(j, v)) for j in judged for v in j.verdicts]


def failed(records: list[dict[str, Any]]) -> list[tuple[int, list[tuple[int, Any]]]]:
    """The steps at which obligations failed, and which: their steps and values."""
    about = [(r["step"], [(each["step"], each["values"]["x"]) for each in r["about"]]) for r in records]
    return [each for each in about if each[1]]


def test_each_trigger_compares_with_its_own_value() -> None:
    records = fed(opened(KEPT), {"limit": 2}, {"limit": 1.5, "v": 1}, {"v": 1.75}, {"v": 9})
    assert failed(records) == [(3, [(2, 1.5)])]
    assert [r["pending"] for r in records] == [1, 2, 0, 0]
    assert records[2]["outcome"] == "currently_false"
    assert "for x = 1.5: always[:2] ({v: *} -> {v <= 1.5})" in records[2]["explanation"]["text"]
    assert "{v <= 1.5}: v = 1.75, wanted <= 1.5, at step 3" in records[2]["explanation"]["text"]


@pytest.mark.parametrize("value", ["7", True])
def test_what_is_no_number_compares_with_none(value: Any) -> None:
    text = "forall[x]. {limit: *x} -> next {v >= *x}"
    assert failed(fed(opened(text), {"limit": value}, {"v": 9})) == [(2, [(1, value)])]
    assert failed(fed(opened(text), {"limit": 1}, {"v": value})) == [(2, [(1, 1)])]
    assert failed(fed(opened(text), {"limit": 2**60 + 1}, {"v": 2**60})) == [(2, [(1, 2**60 + 1)])]


def test_what_fails_is_lost_and_only_where_it_would_decide() -> None:
    signals = {"limit": "msg.limit", "v": "msg.v", "w": "1 / msg.w"}
    session = opened(
        "forall[x]. {limit: *x} -> next {v > *x, w: 1}", StreamSpec("/a", signals=signals), StreamSpec("/b")
    )
    records = fed(session, {"limit": 5}, {"limit": 1, "v": 3, "w": 0}, {"v": 3, "w": 0})
    assert failed(records) == [(2, [(1, 5)])], "3 is not above 5, whatever w is"
    assert records[2]["outcome"] == "unknown"
    assert records[2]["pending"] == 0


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("forall[x]. {v > *x} -> {topic: /a}", "1:12: `v > *x` compares with a variable"),
        ("forall[x]. {v > *x} -> next {v: *x}", "1:12: `v > *x` compares with a variable"),
        ("forall[x]. {v: *x} -> next once {v > *x}", "1:33: `v > *x` stands within `once`"),
        ("forall[x]. {v: *x} -> next exists[y]. {v > *x, w: *y}", "1:39: `v > *x` stands within `exists`"),
        ("{v: *} -> next {v > *x}", "the variable 'x' is free"),
        ("forall[x]. {w: 1} -> next {v > *x}", "for which values of 'x'"),
        ("forall[x]. {v: *x} -> next {v != *x}", "`!=` takes no variable"),
    ],
)
def test_it_is_refused_elsewhere(formula: str, says: str) -> None:
    with pytest.raises(FormulaError) as error:
        parse_formula(formula)
    assert says in f"{error.value.line}:{error.value.column}: {error.value.message}"


def test_it_is_written_as_it_is_read() -> None:
    text = "forall[x]. {limit: *x} -> next {v > *x}"
    assert render(parse_formula(text)) == text
