"""Messages of blocks in the order of recording, and what that takes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracle_server.replay.files import blocks
from oracle_server.replay.files.blocks import Block, in_order
from oracle_server.replay.files.storage import Message


@given(st.lists(st.lists(st.integers(0, 9), max_size=8), max_size=8))
def test_messages_come_by_time_and_of_equal_times_as_they_stand(times: list[list[int]]) -> None:
    content: list[list[Message]] = [[(at, time, b"", 0, at) for at, time in enumerate(block)] for block in times]
    told = [Block(min(block, default=0), offset, 1) for offset, block in enumerate(times)]
    found = [*in_order(told, lambda block: content[block.offset])]
    by_start = sorted(told, key=lambda block: block.start)
    assert found == sorted((m for block in by_start for m in content[block.offset]), key=lambda message: message[1])


def test_blocks_that_all_begin_at_0_are_not_looked_at_again_for_each_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a bag written by the stamps of its messages, some without any: twice as much took four times as long."""
    looked = 0

    def counted(message: Message) -> int:
        nonlocal looked
        looked += 1
        return message[1]

    monkeypatch.setattr(blocks, "_time", counted)
    count, size = 100, 50
    told = [Block(0, offset, 1) for offset in range(count)]

    def read(block: Block) -> list[Message]:
        return [(0, 0 if at == 0 else 1 + block.offset * size + at, b"", 0, at) for at in range(size)]

    found = [*in_order(told, read)]
    assert [message[1] for message in found] == sorted(message[1] for message in found)
    assert len(found) == count * size
    assert looked < 10 * count * size


def test_of_chunks_that_begin_alike_one_at_a_time_is_kept() -> None:
    """As of a writer that knows no times: else all that a file has would be in memory together."""
    taken: list[int] = []

    def read(block: Block) -> list[Message]:
        taken.append(block.offset)
        return [(block.offset, 5, b"", 0, 1), (block.offset, 5 + block.offset % 2, b"", 0, 2)]

    found = [(channel, time, len(taken)) for channel, time, *_ in in_order([Block(5, at, 1) for at in range(4)], read)]
    assert found == [(0, 5, 1), (0, 5, 1), (1, 5, 2), (2, 5, 3), (2, 5, 3), (3, 5, 4), (1, 6, 4), (3, 6, 4)]
