"""How long a call waits for its service: longer at first where its owner says so, as discovery takes time."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from oracle_adapter import unread
from oracle_adapter.unread import TOLD_WITHIN, Unread

from tests.ros2.harness import Peer, Scene, eventually

relay = pytest.importorskip("oracle_ros2.relay")
srv = pytest.importorskip("std_srvs.srv")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


def nothing(*_: Any) -> None:
    """Do nothing."""


@pytest.fixture
def peer(tmp_path: Any) -> Iterator[Peer]:
    with Scene(tmp_path) as scene:
        yield scene.peer()


def test_a_call_waits_longer_for_a_service_that_was_never_there(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr(relay, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    made = relay.Relay(peer.node, srv.Trigger, "/late", "/late_mon", lambda call: None, lambda call, _: None, 10.0)

    def given_up(after: float) -> bool:
        """Whether a call is given up so long (s) after it might go to the service."""
        call = begun()
        assert made.catch_up() == []
        clock[0] += after
        found = made.catch_up()
        made.reply(call, srv.Trigger.Response())
        made.catch_up()
        return bool(found == [call])

    def begun() -> Any:
        """A call that may go to the service."""
        made._serve(srv.Trigger.Request(), lambda response: None)
        [call] = made.open
        made.forward(call)
        return call

    assert not given_up(9.0)
    assert given_up(10.1)

    service = peer.node.create_service(srv.Trigger, "/late", lambda _, response: response)
    peer.until(lambda: made.is_there, "the service is not discovered")
    made.reply(begun(), srv.Trigger.Response())
    call = begun()
    assert made.catch_up() == []
    made.reply(call, srv.Trigger.Response())
    peer.node.destroy_service(service)
    peer.until(lambda: not made.is_there, "the service does not go")
    assert not given_up(1.9)
    assert given_up(2.1)
    made.destroy()


@pytest.mark.parametrize("again", [False, True])
def test_an_answer_that_is_decided_on_is_waited_for_though_its_service_has_ended(
    again: bool, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr(relay, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    answers: list[Any] = []

    def forward(call: Any) -> None:
        made.forward(call)

    made = relay.Relay(
        peer.node,
        srv.Trigger,
        "/led",
        "/led_mon",
        forward,
        lambda call, _: answers.append(call),
    )
    service = peer.node.create_service(srv.Trigger, "/led", lambda _, response: response)
    peer.until(lambda: made.is_there, "the service is not discovered")
    made._serve(srv.Trigger.Request(), lambda response: None)
    peer.until(lambda: answers, "it is not answered")
    peer.node.destroy_service(service)
    if again:
        peer.node.create_service(srv.Trigger, "/led", lambda _, response: response)
    else:
        peer.until(lambda: not made.is_there, "the service does not go")
    for _ in range(3):
        assert made.catch_up() == []
        clock[0] += 2.1
    assert made.open == answers
    made.destroy()


def test_calls_that_came_and_were_not_taken_are_answered_at_the_end_and_go_no_further(tmp_path: Any) -> None:
    """Their clients would wait for ever."""
    with Scene(tmp_path) as scene:
        keeper, pilot, asked = scene.peer("keeper"), scene.peer("pilot"), list[Any]()
        made = relay.Relay(keeper.node, srv.Trigger, "/led", "/led_mon", asked.append, nothing)
        client = pilot.node.create_client(srv.Trigger, "/led_mon")
        pilot.until(client.service_is_ready)
        calls = [client.call_async(srv.Trigger.Request()) for _ in range(5)]  # the keeper never spins
        for call in eventually(made.end, lambda left: len(left) == len(calls)):
            assert made.reply(call, srv.Trigger.Response(message="denied"))
        pilot.until(lambda: all(call.done() for call in calls), "a call is never answered")
        assert [call.result().message for call in calls] == ["denied"] * 5
        assert asked == []
        made.destroy()


def test_a_relay_in_another_s_place_numbers_its_calls_otherwise(peer: Peer) -> None:
    numbers = []
    for _ in range(2):
        made = relay.Relay(peer.node, srv.Trigger, "/led", "/led_mon", lambda call: numbers.append(call.number), print)
        made._serve(srv.Trigger.Request(), lambda response: None)
        made.destroy()
    assert len(set(numbers)) == 2


def test_requests_that_can_not_be_read_are_told_as_one_trouble_and_counted_with_the_next_call(
    peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, calls = [100.0], list[Any]()
    for module in (relay, unread):
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    made = relay.Relay(peer.node, srv.Trigger, "/led", "/led_mon", calls.append, lambda call, _: None)
    assert list(made.look()) == []
    for why in ("it is torn", "it is odd"):
        made._service.callback.unread(why)
    told = ["a request of /led_mon can't be read, and gets no answer: it is torn"]
    assert list(made.look()) == told
    for _ in range(2):
        made._serve(srv.Trigger.Request(), lambda response: None)
    assert [call.lost for call in calls] == [2, 0]
    assert made.overdue() == 0
    clock[0] += 9.9
    assert list(made.look()) == told
    clock[0] += 0.1
    assert list(made.look()) == []
    made.destroy()


def test_what_can_not_be_read_is_to_be_told_by_another_event_where_no_call_follows(peer: Peer) -> None:
    now = 5.0
    made = relay.Relay(peer.node, srv.Trigger, "/led", "/led_mon", nothing, nothing)
    for side in (made._requests, made._responses):
        side.unread = Unread(lambda: now)
    made._service.callback.unread("it is torn")
    made._client.oracle_unread("it is torn")
    assert made.overdue() == 0
    now += TOLD_WITHIN
    assert made.overdue(requests=False, responses=False) == 0, "they would be no events"
    assert (made.overdue(responses=False), made.overdue(), made.overdue()) == (1, 1, 0)
    made.destroy()


def test_responses_that_can_not_be_read_are_told_as_one_trouble_and_counted_with_the_next_one(
    peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, lost = [100.0], list[int]()
    for module in (relay, unread):
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    peer.node.create_service(srv.Trigger, "/led", lambda _, response: response)
    made = relay.Relay(peer.node, srv.Trigger, "/led", "/led_mon", print, lambda call, _: lost.append(call.lost))
    peer.until(lambda: made.is_there, "nobody serves /led")
    for why in ("it is torn", "it is odd"):
        made._client.oracle_unread(why)
    told = ["a response of /led can't be read, and its caller gets none: it is torn"]
    assert list(made.look()) == told
    for number in range(2):
        made._serve(srv.Trigger.Request(), lambda response: None)
        assert made.forward(made.open[-1])
        peer.until(lambda number=number: len(lost) > number, "there is no response")
    assert lost == [2, 0]
    clock[0] += 10
    assert list(made.look()) == []
    made.destroy()


def all_are_answered(folder: Any, serve: Any, *, go_on: bool) -> None:
    """Of forty calls that may go at once."""
    with Scene(folder) as scene:
        caller, other = scene.peer("caller"), scene.peer("other")
        other.node.create_service(srv.Trigger, "/led", serve)
        answers: list[Any] = []
        made = relay.Relay(caller.node, srv.Trigger, "/led", "/led_mon", nothing, lambda call, _: answers.append(call))
        caller.until(lambda: made.is_there, "nobody serves /led")
        for _ in range(40):
            made._serve(srv.Trigger.Request(), lambda response: None)
        calls = made.open
        assert all(made.forward(call) for call in calls)

        def all_answered() -> bool:
            caller._executor.spin_once(timeout_sec=0)
            if go_on:
                made.catch_up()
            return len(answers) == 40

        other.until(all_answered, "calls are lost")
        assert answers == calls
        made.destroy()


def test_calls_that_may_go_at_once_are_as_many_as_a_service_keeps_until_it_answers(tmp_path: Any) -> None:
    all_are_answered(tmp_path, lambda _, response: response, go_on=False)


@pytest.mark.parametrize("takes", [0.01, 0.06, 0.3])
def test_a_service_that_takes_its_time_for_each_of_many_calls_loses_none(
    takes: float, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr(relay, "time", SimpleNamespace(monotonic=lambda: clock[0]))

    def serve(_: Any, response: Any) -> Any:
        clock[0] += takes
        return response

    all_are_answered(tmp_path, serve, go_on=True)


@pytest.mark.parametrize("pause", [1.0, 0.1])
def test_a_service_that_takes_long_gets_more_calls_though_it_answers_none(
    pause: float, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr(relay, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    peer.node.create_service(srv.Trigger, "/led", lambda _, response: response)
    made = relay.Relay(peer.node, srv.Trigger, "/led", "/led_mon", nothing, nothing, pause=pause)
    peer.until(lambda: made.is_there, "nobody serves /led")
    for _ in range(20):
        made._serve(srv.Trigger.Request(), lambda response: None)
        made.forward(made.open[-1])
    gone = []
    for _ in range(3):
        made.catch_up()
        made.catch_up()
        gone.append(sum(call.forwarded for call in made.open))
        clock[0] += 1.25 * pause
    assert gone == [8, 16, 20]
    made.destroy()


def test_of_more_calls_than_wait_for_a_service_that_hangs_the_oldest_are_given_up(
    peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr(relay, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(relay, "MOST", 10)
    answers: list[Any] = []
    peer.node.create_service(srv.Trigger, "/led", lambda _, response: response)
    made = relay.Relay(peer.node, srv.Trigger, "/led", "/led_mon", nothing, lambda call, _: answers.append(call))
    peer.until(lambda: made.is_there, "nobody serves /led")
    left: list[Any] = []
    for _ in range(30):  # 8 go to the service, which is not spun
        made._serve(srv.Trigger.Request(), lambda response: None)
        made.forward(made.open[-1])
        left += (oldest := made.give_up())
        assert all(made.reply(call, srv.Trigger.Response()) for call in oldest)
    last = made.open
    assert (len(left), len(last), made.catch_up()) == (20, 10, [])
    assert left == sorted(left, key=lambda call: call.number)
    clock[0] += relay.PAUSE
    peer.until(lambda: made.catch_up() or len(answers) == 10, "the last calls are not answered")
    assert answers == last
    made.destroy()
