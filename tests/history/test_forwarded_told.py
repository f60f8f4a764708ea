"""What a centre tells of sessions whose robots are behind, or silent, or do not judge them any more."""

from __future__ import annotations

import asyncio
from contextlib import ExitStack
from pathlib import Path

import psycopg
import pytest

from oracle_server.core.episode import Episode
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.forwarding import centre as centre_module
from oracle_server.history.forwarding.working import Bringing
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.sqlite.history import SqliteHistory
from tests.history.forwarded import ORIGIN, at_the_centre, at_the_robot, brought, robot
from tests.history.making import add, opened, step
from tests.postgres import Postgres


async def refused(history: SqliteHistory, session: int) -> str | None:
    await history.flush()
    return history.failure_of(session)


async def test_of_a_backlog_violations_come_with_their_steps(postgres: Postgres, tmp_path: Path) -> None:
    """What has changed comes behind all steps: until then the centre would tell of a session without violations."""
    url, bringing = postgres.empty(), Bringing()
    centre = PostgresHistory(url)
    centre.start(asyncio.get_running_loop())

    async def violations() -> tuple[int, list[int], str | None]:
        (other,) = await centre.open_elsewhere(f"s@{ORIGIN}")
        assert other.place.lasting == (other.trouble is None)
        assert not other.may_end
        return other.steps, [stands.violations for stands in other.properties], other.trouble

    def behind(rows: int) -> str:
        since = "of what was judged there since 1970-01-01 00:00 UTC"
        return f"'{ORIGIN}' is catching up: {since}, {rows} rows are still to come"

    async with robot(tmp_path) as history:
        history.open_session(opened())
        for first, count in ((1, 1), (61, 2)):
            n = 2 * (first + 4) + 1
            episode = StoredEpisode(
                "p", "publication", Episode(n, 5, n + 2, 7, open=False, final=False, count=count), "why"
            )
            history.append(1, [step(p) for p in range(first, first + 60)], lambda: None, (), [episode])
        await history.flush()
        told: list[tuple[int, list[int], str | None]] = []
        while not told or told[-1][0] < 120:
            await brought(history, url, bringing, 50, once=True)
            told.append(await violations())
        assert told == [(50, [1, 0], behind(76)), (100, [3, 0], behind(26)), (120, [3, 0], None)]
        await brought(history, url, bringing)
        bringing.close()
        await asyncio.to_thread(centre.close)
        assert at_the_centre(url) == at_the_robot(tmp_path)


async def test_a_robot_brings_what_it_has_to_a_centre_that_can_not_say_yet_that_more_is_to_come(
    postgres: Postgres, tmp_path: Path
) -> None:
    url, bringing = postgres.empty(), Bringing()
    await asyncio.to_thread(PostgresHistory(url).close)
    postgres.do("ALTER TABLE origins DROP COLUMN behind", url)  # as older versions have it
    async with robot(tmp_path) as history:
        history.open_session(opened())
        await add(history, *(step(p) for p in range(1, 61)))
        await brought(history, url, bringing, 50, once=True)
        centre = PostgresHistory(url)
        centre.start(asyncio.get_running_loop())
        (other,) = await centre.open_elsewhere()
        assert (other.steps, other.trouble) == (50, None), "this robot has not heard of it"
        await asyncio.to_thread(centre.close)
        await brought(history, url, bringing)
        bringing.close()
        assert at_the_centre(url) == at_the_robot(tmp_path)


@pytest.mark.parametrize("held_by", ["another role", "a backup"])
async def test_a_centre_that_can_not_have_told_what_is_to_come_starts_without_that(
    postgres: Postgres, tmp_path: Path, held_by: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The table is another role's, or is read for long, as by pg_dump: others would wait behind who waits for it."""
    schema, bringing = postgres.part(), Bringing()
    url = own = postgres.url(schema)
    await asyncio.to_thread(PostgresHistory(url).close)
    postgres.do("ALTER TABLE origins DROP COLUMN behind", url)  # as older versions have it
    async with robot(tmp_path) as history:
        history.open_session(opened())
        await add(history, *(step(p) for p in range(1, 61)))
        await brought(history, url, bringing, 50, once=True)
        bringing.close()
    with ExitStack() as held:
        if held_by == "a backup":
            reading = held.enter_context(psycopg.connect(url))
            reading.execute("SELECT * FROM origins")
        else:
            postgres.do(f"CREATE ROLE {schema}_user LOGIN; GRANT USAGE ON SCHEMA {schema} TO {schema}_user")
            for kind in ("TABLES", "SEQUENCES"):
                postgres.do(f"GRANT ALL ON ALL {kind} IN SCHEMA {schema} TO {schema}_user")
            own = url.replace("//tests@", f"//{schema}_user@")
        centre = await asyncio.to_thread(PostgresHistory, own)
        told = capsys.readouterr().out
        assert "it is not told which robots are catching up" in told
        assert ("must be owner" if own != url else "lock timeout") in told
        centre.start(asyncio.get_running_loop())
        (other,) = await centre.open_elsewhere(f"s@{ORIGIN}")
        assert (other.steps, other.trouble) == (50, None)
        await asyncio.to_thread(centre.close)


async def test_of_a_robot_that_is_not_heard_any_more_that_is_told(
    postgres: Postgres, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, bringing = postgres.empty(), Bringing()
    centre = PostgresHistory(url)
    centre.start(asyncio.get_running_loop())

    async def stands() -> tuple[bool, str | None]:
        (other,) = await centre.open_elsewhere(f"s@{ORIGIN}")
        assert [other] == await centre.open_elsewhere(origin=ORIGIN) == await centre.open_elsewhere()
        assert await centre.open_elsewhere(origin="robot") == []
        return other.place.lasting, other.trouble

    async with robot(tmp_path) as history:
        history.open_session(opened())
        await add(history, step(1))
        await brought(history, url, bringing)
        assert await stands() == (True, None)
        postgres.do("UPDATE origins SET heard = '2026-01-02 03:04:59+00'", url)
        lasting, trouble = await stands()
        assert not lasting
        assert trouble is not None
        assert trouble.startswith("'robot7' was heard last at 2026-01-02 03:04 UTC")
        assert (await brought(history, url, bringing)).rows == 0
        assert await stands() == (False, trouble), "it was heard a moment ago, and says nothing more so soon"
        monkeypatch.setattr(centre_module, "_HEARD_EVERY", 0.0)
        await brought(history, url, bringing)
        assert await stands() == (True, None)
        postgres.do("UPDATE origins SET heard = clock_timestamp() + interval '1 hour'", url)
        assert not (await stands())[0], "since the database's clock was set back it was not heard"
        await brought(history, url, bringing)
        assert await stands() == (True, None)
    bringing.close()
    await asyncio.to_thread(centre.close)


async def test_that_a_session_is_not_judged_any_more_is_told_at_the_centre(postgres: Postgres, tmp_path: Path) -> None:
    url, bringing = postgres.empty(), Bringing()
    centre = PostgresHistory(url)
    centre.start(asyncio.get_running_loop())

    async def unjudged() -> list[str | None]:
        await history.flush()
        await brought(history, url, bringing)
        return [other.unjudged for other in reversed(await centre.open_elsewhere())]

    async with robot(tmp_path) as history:
        history.open_session(opened())
        history.open_session(opened(2, "other"))
        await add(history, step(1))
        assert await unjudged() == [None, None]
        history.trouble(1, "it could not be restored: \ud800")
        assert await unjudged() == ["it could not be restored: ?", None]
        history.trouble(1, None)
        assert await unjudged() == [None, None]
        history.append(2, [step(1, arrived=2**63)], lambda: None)  # a number that SQLite refuses
        assert await unjudged() == [None, f"nothing more of it can be kept: {await refused(history, 2)}"]
        history.close_session(2, 77, {"id": "other", "continued_by": None})
        assert await unjudged() == [None]
    bringing.close()
    await asyncio.to_thread(centre.close)
