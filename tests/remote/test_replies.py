"""What replies mean, whatever they are."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from oracle_server.core.verdicts import Outcome
from oracle_server.remote.replies import OtherEventError, read_reply
from tests.whole.test_legacy import JSON

EVENT = {"topic": "/a", "time": 12.5, "v": 1}
POSITIVE = {"true", "currently_true"}
NEGATIVE = {"false", "currently_false", "violated", "violation"}


def outcome(text: str | bytes) -> Outcome:
    try:
        return read_reply(text, EVENT).outcome
    except OtherEventError:
        return Outcome.UNKNOWN


def word(value: object) -> str:
    return "" if not isinstance(value, str | bool) else str(value).strip().lower()


@given(JSON | st.sampled_from(sorted(POSITIVE | NEGATIVE)), st.sampled_from(["", "verdict", "ok", "other"]))
def test_only_the_words_are_verdicts(value: object, key: str) -> None:
    said = value[k] if isinstance(value, dict) and (k := "verdict" if "verdict" in value else "ok") in value else value
    found = outcome(json.dumps({key: value} if key else value))
    if found is Outcome.CURRENTLY_TRUE:
        assert word(said) in POSITIVE
        assert key != "other"
    elif found is Outcome.CURRENTLY_FALSE:
        assert word(said) in NEGATIVE
        assert key != "other"
    else:
        assert found is Outcome.UNKNOWN


@given(st.text() | st.binary())
def test_no_noise_is_a_yes(reply: str | bytes) -> None:
    found = outcome(reply)
    text = reply if isinstance(reply, str) else reply.decode(errors="replace")
    assert found is Outcome.UNKNOWN or word(text).strip('"') in POSITIVE | NEGATIVE


@given(st.sampled_from(sorted(POSITIVE | NEGATIVE)), st.sampled_from(["verdict", "ok"]), st.data())
def test_case_and_blanks_do_not_matter(said: str, key: str, data: st.DataObject) -> None:
    spelt = "".join(data.draw(st.sampled_from([c, c.upper()])) for c in said)
    expected = Outcome.CURRENTLY_TRUE if said in POSITIVE else Outcome.CURRENTLY_FALSE
    for text in (
        spelt,
        f" {spelt}\n",
        json.dumps(spelt),
        json.dumps({key: f" {spelt}"}),
        json.dumps(EVENT | {key: spelt}),
    ):
        assert outcome(text) is expected
    assert outcome(json.dumps(EVENT | {key: spelt, "time": 12.5000001})) is expected, "oracles may round"
    assert outcome(json.dumps(EVENT | {key: spelt, "topic": "a"})) is expected
    for other in ({"topic": "/b"}, {"time": 12.6}, {"topic": "/a", "time": 3}):
        assert outcome(json.dumps(EVENT | {key: spelt} | other)) is Outcome.UNKNOWN
