"""The state of a link, frame by frame: attaching, errors, and the end."""

from __future__ import annotations

import json
from typing import List, Optional

import pytest
from oracle_adapter import Answer, Attached, LinkError
from oracle_adapter.notices import Revision, Violation
from tests.adapters.common.side import Frame, Side


class TestAttaching:
    def test_it_says_only_what_was_given(self) -> None:
        hello = json.loads(Side(streams=("/a", "/b"), clock="sim").protocol.hello())
        assert hello == {
            "type": "attach",
            "monitor": "uav1",
            "instance": "i1",
            "streams": ["/a", "/b"],
            "clock": "sim",
        }

    def test_the_second_time_it_names_session_and_spec(self, side: Side) -> None:
        side.attach(session="anonymous-7", spec="battery")
        hello = json.loads(side.protocol.hello())
        assert (hello["session"], hello["spec"]) == ("anonymous-7", "battery")

    def test_the_spec_asked_for_stays(self) -> None:
        side = Side(spec="mine")
        side.attach(spec=None)
        assert json.loads(side.protocol.hello())["spec"] == "mine"

    def test_what_the_server_says_is_passed_on(self, side: Side) -> None:
        stream = {"name": "/SetLED", "kind": "request", "proxy": "/SetLED_mon", "later": [1]}
        (attached,) = side.attach(streams=[stream], limits={"max_frame": 5000})
        assert attached == Attached("uav1", "s1", "battery", "d1", (stream,), {"max_frame": 5000})
        assert side.protocol.attached is attached

    def test_nothing_is_written_before_it(self, side: Side) -> None:
        side.send(1)
        side.protocol.clock([("/a", "topic", 5)])
        assert side.frames() == []

    def test_numbers_go_on_where_the_server_stands(self, side: Side) -> None:
        side.send("a", "b")
        side.attach(upcoming=41)
        side.send("c")
        assert [(event["seq"], event["data"]) for event in side.events()] == [
            (41, "a"), (42, "b"), (43, "c"),
        ]  # fmt: skip


class TestErrors:
    @pytest.mark.parametrize(
        "code",
        ["spec_mismatch", "monitor_taken", "unknown_spec", "unknown_session", "session_closed",
         "forbidden", "unauthorized", "bad_attach", "replaced"],
    )  # fmt: skip
    @pytest.mark.parametrize("flag", [{}, {"fatal": True}])
    def test_some_end_the_link(self, side: Side, code: str, flag: Frame) -> None:
        (error,) = side.receive("error", code=code, message="no", **flag)
        assert (str(error), error.fatal) == (f"{code}: no", True)

    @pytest.mark.parametrize(
        ("code", "fatal"), [("shutting_down", True), ("busy", None), ("forbidden", False)]
    )
    def test_others_do_not(self, side: Side, code: str, fatal: Optional[bool]) -> None:
        flag = {} if fatal is None else {"fatal": fatal}
        (error,) = side.receive("error", code=code, message="no", **flag)
        assert not error.fatal

    @pytest.mark.parametrize(
        "text",
        ["", "{", "[]", "1", "{}", '{"type":"ack"}', '{"type":"ack","upto":null}',
         '{"type":"attached"}', '{"type":"decision","seq":[]}', '{"type":"error"}', b"\xff",
         '{"type":["ack"]}'],
    )  # fmt: skip
    def test_what_is_no_frame_is_told(self, side: Side, text: str) -> None:
        with pytest.raises(LinkError, match="bad_frame"):
            side.protocol.receive(text)

    def test_a_bad_attached_changes_nothing(self, side: Side) -> None:
        side.send(1)
        with pytest.raises(LinkError):
            side.attach(streams=None)
        assert side.protocol.attached is None
        assert side.frames() == []

    def test_unknown_frames_are_left_alone(self, side: Side) -> None:
        assert side.receive("greeting", text="hello") == []

    def test_violations_are_passed_on(self, side: Side) -> None:
        assert side.receive("violation", n=3, property="p") == [
            Violation({"n": 3, "property": "p"})
        ]

    def test_revisions_are_passed_on(self, side: Side) -> None:
        assert side.receive("revision", n=3, retracted=True) == [
            Revision({"n": 3, "retracted": True})
        ]

    def test_features_are_said_where_there_are_any(self) -> None:
        said = [json.loads(s.protocol.hello()) for s in (Side(), Side(features=("revisions",)))]
        assert "features" not in said[0]
        assert said[1]["features"] == ["revisions"]


class TestDetaching:
    def test_it_comes_after_all_else_and_once(self, side: Side) -> None:
        side.attach()
        side.send(1, 2)
        side.protocol.clock([("/a", "topic", 2)])
        side.protocol.detach()
        assert [frame["type"] for frame in side.frames()] == ["events", "clock", "detach"]
        assert side.frames() == []
        assert not side.protocol.done
        side.receive("detached")
        assert side.protocol.done

    def test_nothing_more_is_taken(self, side: Side) -> None:
        side.attach()
        side.protocol.detach()
        assert side.send(1) == [False]
        answer = side.ask()
        assert isinstance(answer, Answer)
        assert answer.reason == "the link is closing"

    def test_it_is_said_again_on_a_new_connection(self, side: Side) -> None:
        side.attach()
        side.send(1)
        side.protocol.detach()
        side.frames()
        side.reconnect(upcoming=1)
        assert [frame["type"] for frame in side.frames()] == ["event", "detach"]

    @pytest.mark.parametrize("values", [[], [1]])
    def test_without_a_connection_it_needs_one_only_to_deliver(
        self, side: Side, values: List[int]
    ) -> None:
        side.send(*values)
        side.protocol.detach()
        assert side.protocol.done == (not values)


def test_what_is_said_of_streams_is_told_once_a_connection(side: Side) -> None:
    assert side.protocol.report("/a", "topic", time_source="field")
    assert side.frames() == []
    both = [{"name": "/a", "kind": "topic"}, {"name": "/b", "kind": "topic"}]
    side.attach(streams=both)
    first = {"stream": "/a", "kind": "topic", "time_source": "field"}
    assert side.frames() == [{"type": "report", "streams": [first]}]
    assert not side.protocol.report("/a", "topic", time_source="field")
    assert side.protocol.report("/b", "topic", trouble="bad")
    second = {"stream": "/b", "kind": "topic", "trouble": "bad"}
    assert side.frames() == [{"type": "report", "streams": [second]}]
    side.reconnect(1, streams=both)
    assert side.protocol.report("/b", "topic", trouble="")
    assert side.frames() == [{"type": "report", "streams": [first, {**second, "trouble": ""}]}]
    assert side.frames() == []


def test_nothing_more_is_said_of_streams_that_the_session_has_no_more(side: Side) -> None:
    for name in ("/a", "/b"):
        side.protocol.report(name, "topic", trouble="bad")
    said = {"stream": "/a", "kind": "topic", "trouble": "bad"}
    side.attach(streams=[{"name": "/a", "kind": "topic"}, {"name": "/b", "kind": "response"}])
    assert side.frames() == [{"type": "report", "streams": [said]}]
    assert not side.protocol.report("/b", "topic", trouble="")
    assert side.frames() == []
