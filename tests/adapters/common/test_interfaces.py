"""The streams that a server describes, by what they belong to."""

from __future__ import annotations

from typing import Any, Dict, List, Tuple

import pytest
from oracle_adapter.interfaces import interfaces_of, is_filtered, report_unknown
from oracle_adapter.kinds import KINDS


def stream(name: str, kind: str, action: str = "log") -> Dict[str, Any]:
    return {"name": name, "kind": kind, "action": action}


def test_a_service_has_two_streams_and_a_topic_of_its_name_is_another_interface() -> None:
    streams = [
        stream("/led", "response"),
        stream("/led", "topic"),
        stream("/set", "request"),
        stream("/led", "request"),
        stream("/set", "response"),
    ]
    found = [(i.type, i.name, i.first["kind"], set(i.streams)) for i in interfaces_of(streams)]
    assert found == [
        ("service", "/led", "request", {"request", "response"}),
        ("topic", "/led", "topic", {"topic"}),
        ("service", "/set", "request", {"request", "response"}),
    ]


@pytest.mark.parametrize(("response", "filtered"), [("log", False), ("filter", True)])
def test_a_service_is_filtered_where_one_of_its_streams_is(response: str, filtered: bool) -> None:
    streams = [stream("/set", "request"), stream("/set", "response", response)]
    (service,) = interfaces_of(streams)
    assert service.filtered is filtered
    assert [is_filtered(s) for s in service.streams.values()] == [False, filtered]


def test_an_action_has_the_streams_that_the_spec_describes() -> None:
    streams = [
        stream("/dock", "reply"),
        stream("/dock", "result", "filter"),
        stream("/dock", "topic"),
    ]
    action, topic = interfaces_of(streams)
    assert (action.type, action.first["kind"], action.filtered) == ("action", "result", True)
    assert (topic.type, set(topic.streams)) == ("topic", {"topic"})
    (alone,) = interfaces_of([stream("/dock", "reply")])
    assert (alone.first["kind"], alone.filtered) == ("reply", False)
    assert not is_filtered(stream("/dock", "status", "filter"))


def test_each_kind_answers_one_of_the_same_interface() -> None:
    for kind in KINDS.values():
        if kind.answers is not None:
            assert KINDS[kind.answers].of == kind.of
            assert KINDS[kind.answers].answers is None


class Notes:
    """In place of a board and of a link, what each is given."""

    def __init__(self) -> None:
        self.shown: List[Tuple[str, str]] = []
        self.reported: List[Tuple[str, str, str]] = []

    def trouble(self, subject: str, text: str) -> bool:
        self.shown.append((subject, text))
        return True

    def report(self, name: str, kind: str, *, trouble: str) -> None:
        self.reported.append((name, kind, trouble))


def test_a_kind_that_is_not_known_is_reported_and_the_others_are_observed() -> None:
    streams = [stream("/dock", "latch"), stream("/pose", "topic")]
    assert [interface.name for interface in interfaces_of(streams)] == ["/pose"]
    notes: Any = Notes()
    report_unknown(streams, notes, notes)
    ((name, text),) = notes.shown
    assert (name, "'latch'" in text) == ("/dock", True)
    assert notes.reported == [("/dock", "latch", text)]
