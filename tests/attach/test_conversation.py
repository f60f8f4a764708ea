"""A conversation without a socket: what comes of each frame in each state, and in which order all is sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracle_server.attach.conversation import FRAMES, MAX_BURST, MAX_QUEUE, TABLE, Conversation, Local, Otherwise, State
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import CreditFrame, Outgoing
from oracle_server.wire.incoming import Attach, Detach, QuickEvent, QuickHandlings
from tests.attach.talks import ATTACHED, OUTCOME, OVER, TEXTS, event, heard, said, talk_in, words, written

CREDIT: CreditFrame = {"type": "credit", "events": 1}


@pytest.mark.parametrize("state", State)
def test_the_table_says_what_comes_of_everything(state: State) -> None:
    assert set(TABLE[state]) == {*FRAMES, *Local}


def test_every_state_is_reached_and_only_the_end_is_final() -> None:
    ways = {state: {step for step in TABLE[state].values() if isinstance(step, State)} - {state} for state in State}
    assert {step for steps in ways.values() for step in steps} == set(State) - {State.WAITING}
    assert [state for state in State if not ways[state]] == [State.ENDED]
    assert all(State.ENDED in ways[state] for state in State if state is not State.ENDED)


HELD = {"events": 2, "events with a bad one": 4, "no message": 0, "attach": 0, "bytes": 0}
"""How many messages a frame holds for a monitor that is attached, where that is not one."""
REFUSED = {
    State.WAITING: {"bytes": ["malformed"], "attach": []},
    State.ATTACHED: {
        "attach": ["bad_attach"],
        "bad event": ["bad_event"],
        "events with a bad one": ["bad_event", "bad_event"],
        "no message": ["malformed"],
        "bytes": ["malformed"],
    },
    State.DETACHING: {"bytes": ["malformed"]},
}
OTHERWISE = {State.WAITING: ["bad_attach"], State.DETACHING: ["detached"]}
"""What a state answers a frame with, where it is not in `REFUSED`."""
ENDING = {(State.WAITING, kind) for kind in TEXTS if kind != "attach"} | {
    (state, "bytes") for state in (State.ATTACHED, State.DETACHING)
}


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize(("kind", "text"), [(kind, text) for kind, texts in TEXTS.items() for text in texts])
def test_each_frame_in_each_state(state: State, kind: str, text: str | bytes) -> None:
    talk = talk_in(state)
    taken = talk.receive(text)
    messages, frames = heard(talk), said(talk)
    assert taken == (state is not State.ATTACHING)
    if state is State.ATTACHED:
        assert len(messages) == HELD.get(kind, 1)
    else:
        assert [type(message) for message in messages] == [Attach] * ((state, kind) == (State.WAITING, "attach"))
    assert words(frames) == REFUSED.get(state, {}).get(kind, OTHERWISE.get(state, []))
    assert all(frame["type"] == "error" and frame["fatal"] == ((state, kind) in ENDING) for frame in frames)
    assert talk.ended == (state is State.ENDED or (state, kind) in ENDING)


def test_a_monitor_is_greeted_before_all_that_was_queued_for_it() -> None:
    talk = talk_in(State.ATTACHING)
    talk.send(CREDIT)
    assert said(talk) == []
    talk.greet(ATTACHED, 7)
    assert said(talk) == [ATTACHED, CREDIT, {"type": "ack", "upto": 7}]


def test_a_monitor_that_has_sent_nothing_before_is_acked_nothing() -> None:
    talk = talk_in(State.ATTACHING)
    talk.greet(ATTACHED, 0)
    assert said(talk) == [ATTACHED]


@pytest.mark.parametrize("state", [State.WAITING, State.ATTACHING])
def test_who_is_dropped_before_the_greeting_is_sent_only_why(state: State) -> None:
    talk = talk_in(state)
    talk.send(CREDIT)
    talk.drop(OVER)
    talk.greet(ATTACHED, 7)
    assert said(talk) == [OVER.frame()]


def test_who_is_dropped_later_is_sent_all_that_was_queued_and_then_why() -> None:
    talk = talk_in(State.ATTACHED)
    talk.send(CREDIT)
    talk.drop(OVER)
    talk.send(CREDIT)
    talk.drop(WireError("internal", "another", fatal=True))
    assert said(talk) == [CREDIT, OVER.frame()]
    assert talk.end == (1008, "session_closed")


@pytest.mark.parametrize(
    ("code", "close"), [("shutting_down", 1012), ("history_unavailable", 1013), ("replaced", 1008), ("internal", 1008)]
)
def test_the_close_says_whether_to_come_back(code: str, close: int) -> None:
    talk = talk_in(State.ATTACHED)
    talk.drop(WireError(code, "it ends", fatal=True))
    assert talk.end == (close, code)


def test_a_monitor_that_has_detached_is_let_go_in_order() -> None:
    talk = talk_in(State.ATTACHED)
    talk.receive('{"type":"detach"}')
    (message,) = heard(talk)
    assert isinstance(message, Detach)
    talk.send({"type": "ack", "upto": 1})
    talk.finish({"type": "detached"})
    assert words(said(talk)) == ["ack", "detached"]
    assert talk.end == (1000, "")


def test_nothing_is_written_to_a_peer_that_is_gone() -> None:
    talk = talk_in(State.ATTACHED)
    talk.send(CREDIT)
    talk.lost()
    talk.send(CREDIT)
    assert said(talk) == []
    assert talk.ended


def test_acks_replace_each_other_only_where_they_follow_each_other() -> None:
    talk = talk_in(State.ATTACHED)
    for upto in (1, 2):
        talk.send({"type": "ack", "upto": upto})
    talk.send(CREDIT)
    for upto in (3, 4):
        talk.send({"type": "ack", "upto": upto})
    assert said(talk) == [{"type": "ack", "upto": 2}, CREDIT, {"type": "ack", "upto": 4}]


def test_what_is_not_read_has_a_limit_at_once_and_a_lower_one_for_long() -> None:
    talk = talk_in(State.ATTACHED)
    for _ in range(MAX_QUEUE):
        talk.send(CREDIT)
    talk.cut_off_crowded()
    assert not talk.ended
    for _ in range(MAX_BURST - MAX_QUEUE):
        talk.send(CREDIT)
    assert not talk.ended
    talk.send(CREDIT)
    assert words(said(talk)) == ["too_slow"]
    assert talk.ended


def test_a_queue_that_stays_too_long_ends_the_conversation() -> None:
    talk = talk_in(State.ATTACHED)
    for _ in range(MAX_QUEUE + 1):
        talk.send(CREDIT)
    talk.cut_off_crowded()
    assert words(said(talk)) == ["too_slow"]


def test_a_batch_is_taken_piece_by_piece_and_a_bad_event_refuses_no_other() -> None:
    talk = talk_in(State.ATTACHED)
    batch = [event(1), event(2, data=1), event(0), event(3)]
    assert talk.receive(written({"type": "events", "events": batch}))
    first = talk.next_message()
    assert isinstance(first, QuickEvent)
    assert said(talk) == []
    _, *_, last = heard(talk)
    assert (first.seq, cast("QuickEvent", last).seq) == (1, 3)
    errors = said(talk)
    assert [(word, frame.get("seq")) for word, frame in zip(words(errors), errors, strict=True)] == [
        ("bad_event", 2),
        ("bad_event", None),
    ]


def test_nothing_more_of_a_batch_is_taken_once_all_is_over() -> None:
    talk = talk_in(State.ATTACHED)
    talk.receive(written({"type": "events", "events": [event(1), event(2)]}))
    talk.next_message()
    talk.drop(OVER)
    assert heard(talk) == []


@pytest.mark.parametrize("text", TEXTS["events"])
def test_a_batch_is_left_for_later_where_it_is_not_wanted(text: str) -> None:
    talk = talk_in(State.ATTACHED)
    assert not talk.receive(text, batches=False)
    assert heard(talk) == []
    assert talk.receive(text)


def test_a_monitor_that_is_too_fast_is_told_once() -> None:
    talk = talk_in(State.ATTACHED)
    talk.throttle()
    talk.throttle()
    assert words(said(talk)) == ["throttled"]


FRAME_TEXTS = [text for texts in TEXTS.values() for text in texts]
ACTIONS: dict[str, Callable[[Conversation, int], object]] = {
    "attach": lambda talk, _: talk.receive(TEXTS["attach"][0]),
    "greet": lambda talk, _: talk.greet(ATTACHED, 0),
    "message": lambda talk, _: talk.next_message(),
    "ack": lambda talk, n: talk.send({"type": "ack", "upto": n}),
    "credit": lambda talk, _: talk.send(CREDIT),
    "throttle": lambda talk, _: talk.throttle(),
    "crowded": lambda talk, _: talk.cut_off_crowded(),
    "drop": lambda talk, _: talk.drop(OVER),
    "detached": lambda talk, _: talk.finish({"type": "detached"}),
    "lost": lambda talk, _: talk.lost(),
}
OFTEN = ["attach", "greet", "message", "ack", "ack", "credit"]


@given(
    st.sampled_from(State),
    st.lists(st.sampled_from(OFTEN) | st.sampled_from([*ACTIONS]) | st.sampled_from(FRAME_TEXTS), max_size=60),
)
def test_whatever_happens_is_answered_in_order(begins: State, happens: list[str | bytes]) -> None:
    talk, out = talk_in(begins), list[Outgoing]()
    greeted = begins not in (State.WAITING, State.ATTACHING)
    for n, what in enumerate(happens):
        before = talk.state
        if isinstance(what, str) and what in ACTIONS:
            ACTIONS[what](talk, n)
        else:
            taken = talk.receive(what)
            assert taken == (before is not State.ATTACHING)
            messages = heard(talk)
            assert before is State.ATTACHED or all(isinstance(message, Attach) for message in messages)
        out += said(talk) if n % 3 == 0 else []
        greeted = greeted or talk.state is State.ATTACHED
        assert greeted or not out or (talk.ended and len(out) == 1)
        assert before is not State.ENDED or talk.ended
    check_order(out + said(talk), greeted=begins not in (State.WAITING, State.ATTACHING), over=talk.ended)


def check_order(out: list[Outgoing], *, greeted: bool, over: bool) -> None:
    """A greeting is first, or nothing but why there is none; nothing comes after a last frame; acks never go back."""
    kinds = [frame["type"] for frame in out]
    assert "attached" not in kinds[0 if greeted else 1 :]
    if out and not greeted and kinds[0] != "attached":
        assert over
        assert len(out) == 1
    last = [frame for frame in out if frame["type"] == "detached" or (frame["type"] == "error" and frame["fatal"])]
    assert last in ([], out[-1:])
    acks = [frame["upto"] for frame in out if frame["type"] == "ack"]
    assert acks == sorted(set(acks))


def test_frames_that_wait_are_only_in_one_row_of_the_table() -> None:
    assert {s for s in State for step in TABLE[s].values() if step is Otherwise.LATER} == {State.ATTACHING}


@pytest.mark.parametrize("spaced", [False, True])
def test_many_outcomes_are_taken_piece_by_piece(*, spaced: bool) -> None:
    outcomes = [OUTCOME | {"seq": seq} for seq in range(1, 151)]
    text, talk = written({"type": "outcomes", "outcomes": outcomes}, spaced=spaced), talk_in(State.ATTACHED)
    assert not talk.receive(text, batches=False)
    assert talk.receive(text)
    pieces = []
    while (message := talk.next_message()) is not None:
        assert talk.in_batch
        assert isinstance(message, QuickHandlings)
        pieces.append([outcome.seq for outcome in message.outcomes])
    assert not talk.in_batch
    assert [seq for piece in pieces for seq in piece] == [*range(1, 151)]
    assert max(map(len, pieces)) < 150
