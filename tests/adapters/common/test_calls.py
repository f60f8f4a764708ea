"""The numbers of calls: no other process's, and such as the wire takes."""

from __future__ import annotations

from itertools import islice

from oracle_adapter.calls import call_numbers


def test_an_adapter_that_is_started_again_has_other_numbers_one_after_the_other() -> None:
    before, after = (list(islice(call_numbers(), 1000)) for _ in range(2))
    assert not {*before} & {*after}
    for numbers in (before, after):
        assert numbers == list(range(numbers[0], numbers[0] + 1000))
        assert 0 < numbers[0] <= 2**52
