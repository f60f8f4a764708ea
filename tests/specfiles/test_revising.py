"""`late: revise` in spec files: what it can't do is refused, and old specs mean what they meant."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import Finding, SpecError
from oracle_server.core.plan import judged_by, plan
from oracle_server.core.spec import SECOND
from oracle_server.specfiles.load import parse_spec

SPEC = """id: s
streams:
  - topic: /a
    signals: {v: msg.v}
ordering: {late: revise, horizon: 5s}
properties:
  - {id: p, formula: 'not {v: 1}'}
"""


def findings(text: str) -> tuple[Finding, ...]:
    with pytest.raises(SpecError) as refused:
        parse_spec(text, "x.yaml")
    return refused.value.findings


def test_the_horizon_is_read_and_counts_for_the_meaning() -> None:
    spec = parse_spec(SPEC, "x.yaml").spec
    assert (spec.ordering.late, spec.ordering.horizon) == ("revise", 5 * SECOND)
    other = parse_spec(SPEC.replace("5s", "6s"), "x.yaml").spec
    assert spec.digest != other.digest
    assert parse_spec(SPEC.replace(", horizon: 5s", ""), "x.yaml").spec.ordering.horizon == 2 * SECOND


def test_specs_that_do_not_revise_have_the_digest_that_they_had() -> None:
    plain = SPEC.replace("ordering: {late: revise, horizon: 5s}\n", "")
    assert parse_spec(plain, "x.yaml").spec.digest == "040ef100584879ae0e19be96deb62dc940b403dd18f1593b0372af3577ef1378"


@pytest.mark.parametrize(
    ("old", "new", "line", "told"),
    [
        ("late: revise", "late: revise, by: arrival", 5, "leave `by` out, or write `late: judge`"),
        ("late: revise", "late: revise, by: both", 5, "leave `by` out, or write `late: judge`"),
        ("late: revise, ", "", 5, "`horizon` is that of `late: revise`"),
        ("horizon: 5s", "horizon: 0s", 5, "longer than 0s and at most an hour"),
        ("horizon: 5s", "horizon: 2h", 5, "longer than 0s and at most an hour"),
        ("id: p,", "id: p, engine: reelay,", 7, "`engine: reelay` can't go back; `native` can"),
        ("topic: /a", "topic: /a\n    ordered: false", 6, "no stream is ordered"),
    ],
)
def test_what_can_not_be_revised_is_refused_at_its_place(old: str, new: str, line: int, told: str) -> None:
    text = SPEC.replace(old, new)
    found = findings(text)
    assert [f.line for f in found if told in f.message] == [line], found


def test_a_session_that_is_asked_for_by_arrival_does_not_revise() -> None:
    ready = judged_by(plan(parse_spec(SPEC, "x.yaml").spec), "arrival")
    assert ready.spec.ordering.late == "judge"
