"""A monitor's numbers, whatever it sends again or skips: each is taken once, and acked once all before it are."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.ordering.numbering import JUDGED, Numbering

happenings = st.lists(
    st.one_of(
        st.tuples(st.just("send"), st.integers(1, 3)),
        st.tuples(st.just("again"), st.integers(0, 20)),
        st.tuples(st.just("lost after all"), st.integers(0, 20)),
        st.tuples(st.just("commit"), st.integers(0, 5)),
        st.tuples(st.sampled_from(["resume", "restart"]), st.just(0)),
    ),
    max_size=60,
)


@settings(max_examples=1000, deadline=None)
@given(happenings)
def test_each_number_is_taken_once_and_acked_when_all_before_it_are_used_up(found: list[tuple[str, int]]) -> None:
    numbering = Numbering()
    taken: list[tuple[int, int]] = []
    committed: list[tuple[int, int]] = []
    sent: list[int] = []
    lost: list[int] = []
    newest = 0
    for what, number in found:
        acked = numbering.upto
        match what:
            case "send":
                lost += range(newest + 1, newest + number)
                seq = newest + number
                newest = seq
                gap = numbering.take(seq)
                assert gap == number - 1, "a gap is told, or a number is not judged"
                taken.append((seq, gap))
                sent.append(seq)
            case "again" if sent:
                assert numbering.take(sent[number % len(sent)]) is None, "judged twice"
            case "lost after all" if lost:
                seq = lost.pop(number % len(lost))
                gap = numbering.take(seq)
                assert (gap is None) is (seq <= acked), "told as lost and acked, or to be judged before it is"
                if gap is not None:
                    taken.append((seq, gap))
                    sent.append(seq)
            case "commit" if taken:
                settled = taken.pop(number % len(taken))
                committed.append(settled)
                numbering.commit(*settled)
            case "resume":
                numbering.resume()
                assert numbering.next == numbering.upto + 1, "all that is not used up is to be sent again"
                assert all(numbering.take(seq) is None for seq in sent if seq > numbering.upto)
            case "restart":
                numbering.restart()
                assert all(seq < numbering.next for seq, _ in taken), "its numbers would mean others"
                newest = numbering.next - 1
        assert numbering.upto >= acked, "acks never go back"
        assert not any(seq <= numbering.upto for seq, _ in taken), "acked, and not in the history"
    for settled in taken:
        numbering.commit(*settled)
    told = [(seq, gap, JUDGED) for seq, gap in committed + taken]
    again = Numbering(told)
    assert again.upto == numbering.upto, "it comes back from the history as it was"
    assert again.next == again.upto + 1, "all that is not used up is to be sent again"
    half = Numbering(told[::2])
    assert Numbering(told[1::2], half.saved()).upto == numbering.upto, "or from what was saved, and what came since"
    assert Numbering(told[::2] + told[1::2], half.saved()).upto == numbering.upto, "or was there already"


def test_what_was_lost_or_refused_is_told_with_the_next_event_that_is_judged() -> None:
    numbering = Numbering()
    for seq in (1, 2, 4, 5):
        numbering.take(seq)
    numbering.commit(1, 0)
    numbering.commit(2, 0, 1)
    assert numbering.lost == 1
    numbering.commit(5, 0)
    assert numbering.lost == 1, "what is to tell of it is not in the history yet"
    assert Numbering((), numbering.saved()).lost == 1
    numbering.commit(4, 1, 2)
    assert numbering.lost == 0


def test_a_loss_beyond_what_is_not_used_up_is_told_by_the_very_next_event_that_is_judged() -> None:
    numbering = Numbering()
    for seq in (1, 2, 3, 4, 5):
        numbering.take(seq)
    numbering.commit(2, 0, 1)
    assert numbering.lost == 1
    numbering.commit(4, 0)
    assert numbering.lost == 1, "the next one is the third"
    numbering.commit(3, 0, 5)
    assert numbering.lost == 0, "the fourth tells of both"
    numbering.commit(5, 0, 2)
    assert numbering.lost == 2
    numbering.commit(1, 0)
    assert numbering.upto == 5
    assert numbering.lost == 2


def test_a_loss_that_was_saved_is_not_told_twice() -> None:
    numbering = Numbering()
    for seq in (1, 2, 3):
        numbering.take(seq)
    refused = [(1, 0, 2), (3, 0, 5)]
    for each in refused:
        numbering.commit(*each)
    assert (numbering.upto, numbering.lost) == (1, 7)
    assert Numbering(refused, numbering.saved()).lost == 7


def test_what_is_held_is_not_taken_again_and_not_lost() -> None:
    numbering = Numbering()
    assert numbering.take(1) == 0
    assert numbering.take(4) == 2
    numbering.hold(6)
    assert numbering.take(8) == 2, "the fifth and the seventh"
    assert numbering.take(6) is None
