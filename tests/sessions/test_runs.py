"""The names of runs: told apart from others, followed, and never longer than a name may be."""

from __future__ import annotations

import re

import pytest

from oracle_server.core.spec import IDENTIFIER
from oracle_server.sessions.runs import beginning, goes_on, last_run, named, run_of


@pytest.mark.parametrize(
    ("name", "run"),
    [
        ("s1", ("s1", 1)),
        ("s1.run2", ("s1", 2)),
        ("s1.run2.run13", ("s1.run2", 13)),
        ("s1.run1", ("s1.run1", 1)),
        ("s1.run02", ("s1.run02", 1)),
        ("s1.run²", ("s1.run²", 1)),
        (".run", (".run", 1)),
    ],
)
def test_a_name_tells_its_run(name: str, run: tuple[str, int]) -> None:
    assert run_of(name) == run


@pytest.mark.parametrize("stem", ["s", "x" * 50, "x" * 64])
@pytest.mark.parametrize("run", [2, 10, 365, 10**6])
def test_every_run_has_a_name_that_is_found_again(stem: str, run: int) -> None:
    name = named(stem, run)
    assert re.match(IDENTIFIER, name)
    assert goes_on(name, stem)
    assert name.startswith(beginning(stem))
    assert last_run(stem, [stem, name, "other.run999"]) == run
    later = named(run_of(name)[0], run * 10)
    assert last_run(stem, [later]) == run * 10


def test_nothing_known_has_no_run() -> None:
    assert last_run("s1", ["s", "s11", "s1.runs", "s11.run4"]) == 0
    assert last_run("s1", ["s1"]) == 1
