"""A monitor's numbers, whatever it sends again or skips: each is taken once, and acked once all before it are."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.numbering import Numbering

happenings = st.lists(
    st.one_of(
        st.tuples(st.just("send"), st.integers(1, 3)),
        st.tuples(st.just("again"), st.integers(0, 20)),
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
    newest = 0
    for what, number in found:
        acked = numbering.upto
        match what:
            case "send":
                seq = newest + number
                newest = seq
                gap = numbering.take(seq)
                assert gap == number - 1, "a gap is told, or a number is not judged"
                taken.append((seq, gap))
                sent.append(seq)
            case "again" if sent:
                assert numbering.take(sent[number % len(sent)]) is None, "judged twice"
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
    again = Numbering(committed + taken)
    assert again.upto == numbering.upto, "it comes back from the history as it was"
