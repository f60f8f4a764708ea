"""When keys had samples, against a plain list, where what was done may be taken back."""

from __future__ import annotations

import random

import pytest

from oracle_server.core.derived import queue
from oracle_server.core.derived.journal import Journal
from oracle_server.core.derived.queue import Key, Queue

Pairs = list[tuple[int, Key]]


def what_it_says(found: Queue, now: int) -> list[object]:
    return [(found.next_after(at), list(found.at(at))) for at in range(now + 2)]


def what_a_list_says(pairs: Pairs, now: int) -> list[object]:
    return [
        (min((p for p, _ in pairs if p > at), default=None), [key for p, key in pairs if p == at])
        for at in range(now + 2)
    ]


def test_it_is_as_a_list_whatever_is_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(queue, "_LEAST", 3)
    trimmed = filled = 0
    for seed in range(150):
        rng, journal = random.Random(seed), Journal()
        found, pairs, now = Queue(journal), Pairs(), 0
        marks: list[tuple[Pairs, int]] = []
        for _ in range(60):
            now += rng.choice((0, 0, 1, 2))
            act = rng.choice(("add", "add", "add", "pass", "mark", "back", "keep"))
            if act == "add":
                pairs = [*pairs, (now, rng.choice("uvw"))]
                found.add(*pairs[-1])
                if found.is_long and found.trim():
                    trimmed += bool(marks)
                elif found.is_long:
                    filled += bool(marks)
                    pairs = [pair for i, pair in enumerate(pairs) if i % 3]
                    found.fill(pairs)
            elif act == "pass":
                limit = now - rng.randint(0, 4)
                assert found.pass_by(limit) == [key for at, key in pairs if at <= limit]
                pairs = [pair for pair in pairs if pair[0] > limit]
            elif act == "mark":
                journal.mark()
                marks.append((pairs, now))
            elif marks:
                (journal.back if act == "back" else journal.keep)()
                known = marks.pop()
                pairs, now = known if act == "back" else (pairs, now)
            assert what_it_says(found, now) == what_a_list_says(pairs, now), seed
            assert found.is_spent is (not pairs)
    assert min(trimmed, filled) > 20
