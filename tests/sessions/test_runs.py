"""The names of runs: told apart from others, followed, and never longer than a name may be."""

from __future__ import annotations

import asyncio
import re

import pytest

from oracle_server.core.spec import IDENTIFIER
from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions import runs
from oracle_server.sessions.endings import Runs
from oracle_server.sessions.runs import beginning, goes_on, last_run, named, run_of
from tests.history.making import opened


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
    assert last_run(stem, [stem, name, "other.run999"]) == name
    later = named(run_of(name)[0], run * 10)
    assert last_run(run_of(name)[0], [name, later]) == later
    assert last_run(stem, [stem, name, named(stem, run * 10)]) == named(stem, run * 10)
    assert last_run(stem, [later]) == later


def test_of_many_sessions_few_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """All others wait for it where a monitor opens a session: each name was compared with each."""
    looked: list[str] = []

    def counted(name: str) -> tuple[str, int]:
        looked.append(name)
        return run_of(name)

    monkeypatch.setattr(runs, "run_of", counted)
    assert last_run("s", [*(f"robot{i}" for i in range(1000)), "s", "s.run2"]) == "s.run2"
    assert len(looked) < 10


def test_nothing_known_has_no_run() -> None:
    assert last_run("s1", ["s", "s11", "s1.runs", "s11.run4"]) is None
    assert last_run("s1", ["s1"]) == "s1"


STEM = "warehouse-north_2026-11-28T08-00_cell-17_forklift_line-000001"


@pytest.mark.parametrize("length", [42, 52, 59, 60, 61])
@pytest.mark.parametrize("run", [2, 10, 365, 10**6])
def test_sessions_whose_long_names_begin_alike_have_runs_of_their_own(length: int, run: int) -> None:
    one, two = (f"{STEM[:length]}{end}" for end in "AB")
    names = [named(one, run), named(two, run)]
    assert len({*names}) == 2
    assert last_run(one, [one, two, *names]) == names[0]
    assert last_run(two, [one, two, *names]) == names[1]
    assert [goes_on(name, one) for name in names] == [True, False]
    assert names[0].startswith(beginning(one))
    assert names[1].startswith(beginning(two))


def test_a_run_that_an_older_version_named_is_found_unless_it_may_be_anothers() -> None:
    one, two, was = f"{STEM}A", f"{STEM}B", f"{STEM[:59]}.run2"
    assert was.startswith(beginning(one))
    assert goes_on(was, one)
    assert last_run(one, [one, was]) == was
    assert last_run(one, [one, was, named(one, 2)]) == named(one, 2)
    assert last_run(one, [one, two, was]) == one
    assert last_run(one, [one, STEM[:59], was]) == one, "it is a run of the one with the shorter name"
    assert last_run(STEM[:59], [one, STEM[:59], was]) == was
    assert named(run_of(was)[0], 3) == f"{STEM[:59]}.run3"


async def test_who_begins_anew_by_a_long_name_gets_no_others_session() -> None:
    history = MemoryHistory()
    history.start(asyncio.get_running_loop())
    open_: dict[str, object] = {}
    runs, names = Runs(history, open_, {}), [f"{STEM}{robot}" for robot in "AB"]
    for number, name in enumerate(names, 1):
        history.open_session(opened(number, name))
        history.close_session(number, 5, {})
    await history.flush()
    for name in names:
        following = await runs.anew(name)
        assert following not in open_, "another robot is in it"
        open_[following] = name
    assert [await runs.anew(name) for name in names] == list(open_), "who comes back is in the same one"
    history.close()
