"""What a history keeps of episodes, and how it is asked for them; the same over each backend."""

from __future__ import annotations

import asyncio
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from oracle_server.core.episode import Episode, Worst
from oracle_server.core.verdicts import Outcome
from oracle_server.history.episodes import Cursor, EpisodeQuery, StoredEpisode
from oracle_server.history.port import History
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.history.whose import Whose
from tests.history.making import PROPERTIES, add, opened, step

HELD, FALSE = Outcome.CURRENTLY_TRUE, Outcome.CURRENTLY_FALSE
WORST = Worst(signal="v", op="<=", bound=1, value=1.5)


def episode(first: int, began: int, *, until: int | None = None, count: int = 1, final: bool = False) -> Episode:
    """An episode; it is open where nothing is said of its end."""
    end = began if until is None else until
    return Episode(first, began, first, end, until is None, final, count, WORST)


async def keep(history: History, session: int, *episodes: StoredEpisode) -> None:
    history.append(session, (), lambda: None, (), episodes)
    await history.flush()


async def firsts(history: History, query: EpisodeQuery = EpisodeQuery()) -> list[int]:  # noqa: B008 -- it is frozen
    return [record["first"] for record in (await history.episodes(query))[0]]


@pytest.fixture
async def filled(history: History) -> History:
    """Two sessions with episodes: the numbers of the first verdicts tell them apart."""
    history.open_session(opened(1, "s"))
    history.open_session(opened(2, "t")._replace(spec="other"))
    await keep(
        history, 1,
        StoredEpisode("p", "publication", episode(11, 100, until=150), "p fails"),
        StoredEpisode("q", "publication", episode(12, 120), "q fails"),
        StoredEpisode("p", "publication", episode(31, 300, until=310), "p fails again"),
    )  # fmt: skip
    await keep(history, 2, StoredEpisode("p", "publication", episode(21, 120, until=400), "it fails"))
    return history


async def test_one_is_told_with_all_that_is_known_of_it(filled: History) -> None:
    (first, second), _ = await filled.episodes(EpisodeQuery(session=1, until=200))
    assert first == {
        "session": "s", "spec": "spec", "property": "p", "order": "publication", "first": 11, "began": 100, "last": 11,
        "until": 150, "open": False, "final": False, "count": 1,
        "worst": {"signal": "v", "op": "<=", "bound": 1, "value": 1.5}, "explanation": "p fails",
    }  # fmt: skip
    assert (second["open"], second["last"], second["until"]) == (True, None, None)


@pytest.mark.parametrize(
    ("query", "found"),
    [
        (EpisodeQuery(), [11, 12, 21, 31]),
        (EpisodeQuery(order="desc"), [31, 21, 12, 11]),
        (EpisodeQuery(session=1), [11, 12, 31]),
        (EpisodeQuery(properties=frozenset({"p"})), [11, 21, 31]),
        (EpisodeQuery(open=True), [12]),
        (EpisodeQuery(open=False), [11, 21, 31]),
        (EpisodeQuery(since=151), [12, 21, 31]),
        (EpisodeQuery(until=119), [11]),
        (EpisodeQuery(since=305, until=305), [12, 21, 31]),
        (EpisodeQuery(whose=Whose(specs=frozenset({"other"}))), [21]),
        (EpisodeQuery(whose=Whose(sessions=frozenset({"s"}))), [11, 12, 31]),
        (EpisodeQuery(whose=Whose(sessions=frozenset())), []),
        (EpisodeQuery(whose=Whose(frozenset({"other"}), frozenset({"s"}))), []),
    ],
)
async def test_those_are_found_that_are_asked_for(filled: History, query: EpisodeQuery, found: list[int]) -> None:
    assert await firsts(filled, query) == found


ROBOTS = ("s@robot7", "s@Robot7", "s@robot70", "s@robot_", "t@robot7", "@robot7", "robot7", "s7", "s@7")


@pytest.mark.parametrize("origin", ["robot7", "Robot7", "robot70", "robot_", "7", "robot.", "robot"])
async def test_those_of_a_robot_are_its_own_alone(history: History, origin: str) -> None:
    for number, name in enumerate(ROBOTS, 1):
        history.open_session(opened(number, name))
        await keep(history, number, StoredEpisode("p", "publication", episode(number, 100)))
        history.close_session(number, 500, {"id": name})
    await history.flush()
    own = [name for name in ROBOTS if "@" in name and name.split("@")[1] == origin]
    found, _ = await history.episodes(EpisodeQuery(whose=Whose(origin=origin)))
    assert [record["session"] for record in found] == own
    assert [state["id"] for state in await history.closed_states(2, Whose(origin=origin))] == own[::-1][:2]


@pytest.mark.parametrize("order", ["asc", "desc"])
async def test_pages_have_each_once(filled: History, order: str) -> None:
    query, found, pages = EpisodeQuery(limit=1, order="desc" if order == "desc" else "asc"), [], 0
    while True:
        page, after = await filled.episodes(query)
        found += [record["first"] for record in page]
        pages += 1
        if after is None:
            break
        query = replace(query, after=Cursor.parse(after.written()))
    assert found == await firsts(filled, replace(query, limit=100, after=None))
    assert pages == 4


@pytest.mark.parametrize("text", ["", "1:2:p", "1:2:p:x", "-1:2:p:3", "1:2:p:3:4", f"{2**63}:1:p:1"])
def test_what_is_no_cursor_is_none(text: str) -> None:
    assert Cursor.parse(text) is None


async def test_what_joins_one_keeps_its_explanation(filled: History) -> None:
    joined = episode(12, 120, until=200, count=3)
    await keep(filled, 1, StoredEpisode("q", "publication", joined))
    ((record,), _) = await filled.episodes(EpisodeQuery(properties=frozenset({"q"})))
    assert (record["count"], record["until"], record["explanation"]) == (3, 200, "q fails")


async def test_what_does_not_stand_is_gone(filled: History) -> None:
    gone = StoredEpisode("p", "publication", episode(11, 100), gone=True)
    await keep(filled, 1, gone, StoredEpisode("p", "publication", episode(13, 90, until=95), "earlier"))
    assert await firsts(filled, EpisodeQuery(session=1)) == [13, 12, 31]


async def test_one_that_changes_twice_in_a_batch_is_kept_as_it_is_last(filled: History) -> None:
    changes = [StoredEpisode("p", "publication", episode(15, 100, until=100 + n, count=n)) for n in (1, 2)]
    begun, last = changes[0]._replace(text="why"), changes[1]
    gone = [each._replace(episode=episode(17, 100), gone=each is last) for each in (begun, last)]
    await keep(filled, 1, begun, *gone, last)
    found = {record["first"]: record for record in (await filled.episodes(EpisodeQuery(session=1)))[0]}
    assert (found[15]["count"], found[15]["explanation"]) == (2, "why")
    assert 17 not in found


async def test_none_is_open_in_a_closed_session(filled: History) -> None:
    filled.close_session(1, 500, {"id": "s"})
    await filled.flush()
    assert await firsts(filled, EpisodeQuery(open=True)) == []
    assert await firsts(filled, EpisodeQuery(session=1)) == [11, 12, 31]


async def test_those_that_ended_go_with_their_rows(filled: History) -> None:
    await filled.forget_steps(1, 1 + 12 // len(PROPERTIES))
    assert await firsts(filled, EpisodeQuery(session=1)) == [12, 31], "what is open stays, and what has rows"
    await filled.forget_session(1)
    assert await firsts(filled) == [21]


async def test_an_older_history_has_those_of_its_rows(tmp_path: Path) -> None:
    older = SqliteHistory(tmp_path)
    older.start(asyncio.get_running_loop())
    second = 10**9
    older.open_session(opened())
    outcomes = [(HELD, HELD), (FALSE, HELD), (HELD, HELD), (FALSE, FALSE), (HELD, FALSE)]
    steps = [
        step(i, stamp=i * second // 2, outcomes=each, violated=[k for k in (0, 1) if each[k] is FALSE and i < 5])
        for i, each in enumerate(outcomes, 1)
    ]
    await add(older, *steps)
    await asyncio.to_thread(older.close)
    with closing(sqlite3.connect(older.path)) as database:
        database.execute("DROP TABLE episodes")
        database.execute("DROP INDEX steps_by_seq")
        database.execute("ALTER TABLE steps DROP COLUMN row")
        database.execute("PRAGMA user_version = 9")
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    found, _ = await history.episodes(EpisodeQuery())
    told = [(e["property"], e["first"], e["began"], e["until"], e["open"], e["count"], e["explanation"]) for e in found]
    assert told == [
        ("p", 3, second, second, False, 1, "p does not hold"),
        ("p", 7, 2 * second, 2 * second, False, 1, "p does not hold"),
        ("q", 8, 2 * second, None, True, 1, "q does not hold"),
    ]
    await asyncio.to_thread(history.close)
