"""Sequences against `re`, and against their meaning where `re` has no counterpart."""

from __future__ import annotations

import random
import re
from itertools import product

import pytest

from oracle_server.core.errors import FormulaError
from oracle_server.core.machines.sequence import by_sequence
from oracle_server.core.machines.table import Table

LETTERS = "abc"
LONGEST = 5
AHEAD = 4
WORDS = ["".join(w) for n in range(LONGEST + 1) for w in product(LETTERS, repeat=n)]


def run(table: Table, word: str) -> str:
    state = table.start
    for letter in word:
        state = table.after(state, 1 << table.events.index(letter)) if letter in table.events else state
    value = table.values[state]
    assert value is not None
    return value


def expression(rng: random.Random, depth: int) -> tuple[str, str]:
    """A sequence, and the same for `re`."""
    if not depth or rng.random() < 0.2:
        letter = rng.choice(LETTERS)
        return letter, letter
    one, other = expression(rng, depth - 1), expression(rng, depth - 1)
    how = rng.choice(("|", " ", " ", "*", "+", "?", "{2}", "{1,2}", "{2,}", "{0}"))
    if how == "|":
        return f"({one[0]} | {other[0]})", f"(?:{one[1]}|{other[1]})"
    if how == " ":
        return f"({one[0]} {other[0]})", f"(?:{one[1]}{other[1]})"
    return f"({one[0]}){how}", f"(?:{one[1]}){how}"


def test_a_sequence_is_what_re_says() -> None:
    rng = random.Random(3)
    judged = 0
    for _ in range(60):
        text, pattern = expression(rng, 3)
        found = re.compile(pattern)
        matching = {word for word in WORDS if found.fullmatch(word)}
        try:
            table = by_sequence(text, LETTERS)
        except FormulaError:
            assert not matching
            continue
        letters = [word for word in WORDS if set(word) <= {*table.events}]
        for word in letters if len(table.names) <= AHEAD + 1 else ():
            value = run(table, word)
            assert (value == "matched") == (word in matching), (text, word)
            if len(word) < LONGEST - AHEAD + 1:
                open_ = any(found.fullmatch(word + end) for end in WORDS if len(end) <= AHEAD)
                assert (value != "failed") == open_, (text, word)
            judged += 1
    assert judged > 1_500


@pytest.mark.parametrize(
    ("text", "matched", "failed"),
    [
        ("!(a b)", {"", "a", "b", "aba"}, set[str]()),
        ("(a | b)* & !((a | b)* b b (a | b)*)", {"", "a", "b", "ab", "bab"}, {"bb", "abb", "bba"}),
        ("!!a", {"a"}, {"aa", "ab"}),
        ("!a* & (a | b)", {"b"}, {"aa", "ba"}),
    ],
)
def test_and_also_what_is_not(text: str, matched: set[str], failed: set[str]) -> None:
    table = by_sequence(text, LETTERS)
    words = {"", "a", "b", "aa", "ab", "ba", "bb", "aba", "abb", "bab", "bba"}
    words = {word for word in words if set(word) <= {*table.events}}
    assert {word for word in words if run(table, word) == "failed"} >= failed & words
    assert not matched & {word for word in words if run(table, word) != "matched"}


@pytest.mark.parametrize(
    ("text", "message", "column"),
    [
        ("a (b | opne) c", "unknown event 'opne'; did you mean `open`?", 8),
        ("a b {2", "a count is written as", 5),
        ("a | ", "here stands an event, or several in parentheses, and not the end", 5),
        ("a ) b", "`)` is not expected here", 3),
        ("(a b", "a `)` is missing", 5),
        ("a & b", "nothing can match this sequence", 1),
        ("a{3,1}", "from more to fewer: write `{1,3}`", 2),
        ("", "the sequence is empty", 1),
        ("(a | b)* a (a | b){12}", "more than 1,000 states", 1),
        ("((a | b)* & !(a{1000} b)){1000} a", "more than 1,000 states", 1),
        (" ".join(["a?"] * 201), "at most 200 names", 601),
        ("(" * 50 + "a" + ")" * 50, "nested more than 40 deep", 41),
    ],
)
def test_what_is_refused(text: str, message: str, column: int) -> None:
    with pytest.raises(FormulaError) as caught:
        by_sequence(text, ("a", "b", "c", "open"))
    assert message in caught.value.message
    assert (caught.value.line, caught.value.column) == (1, column)


def test_as_many_parts_as_there_may_be_are_read() -> None:
    table = by_sequence(" ".join(["a?"] * 200), "a")
    assert run(table, "a" * 200) == "matched"
    assert run(table, "a" * 201) == "failed"
