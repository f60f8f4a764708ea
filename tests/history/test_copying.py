"""A history that is copied to another database is the same one, wherever the copy was ended and went on."""

from __future__ import annotations

import asyncio
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from oracle_server.core.bypass import Bypass
from oracle_server.core.episode import Episode, Worst
from oracle_server.core.errors import HistoryError, OracleError
from oracle_server.core.events import StreamKey
from oracle_server.core.verdicts import Decision
from oracle_server.history.copying import run
from oracle_server.history.copying.ends import End
from oracle_server.history.copying.inpostgres import PostgresEnd
from oracle_server.history.copying.insqlite import SqliteEnd
from oracle_server.history.copying.run import Copied
from oracle_server.history.copying.tables import tables
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.port import History
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.records import MonitorRecord, Refusal, SnapshotRecord, stored_revision
from oracle_server.history.sql.rows import Row
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.process.pidfile import PidFile
from tests.history.making import add, opened, revision, step
from tests.history.test_standing import FALSE, HELD, change, stands
from tests.postgres import Postgres
from tests.whole.harness import run as command

STRANGE = "\0a\1b\0\\u0000\t\n'\"%s$1?é😀"
ENDED = """
import os, signal, sys
from oracle_server.history.copying import inpostgres, insqlite, run
from oracle_server.history.copying.inpostgres import PostgresEnd
from oracle_server.history.copying.insqlite import SqliteEnd

run._ROWS = inpostgres.BATCH = insqlite.BATCH = 24
end, left = (PostgresEnd if sys.argv[2].startswith("postgres") else SqliteEnd), 0

def ending(name):
    done = getattr(end, name)
    def counting(self, *values):
        global left
        if values and "SELECT" not in str(values[0]):
            left -= 1
            if not left:
                os.kill(os.getpid(), signal.SIGKILL)
        return done(self, *values)
    setattr(end, name, counting)

ending("execute")
ending("insert")
killed = 0
while True:
    pid = os.fork()
    if not pid:
        left = killed * 5 % 17 + 6
        run.copy_history(*sys.argv[1:])
        os._exit(0)
    _, status = os.waitpid(pid, 0)
    if not os.WIFSIGNALED(status):
        sys.exit(0 if status == 0 and killed > 4 else f"status {status} after {killed} times")
    killed += 1
"""
"""A copy by small pages, which is killed at its sixth statement, goes on, is killed at its eleventh, and so on."""


async def fill(history: History, *, forgetful: bool = False) -> None:
    """Have some of everything in a history: a row in each table, a value in each column.

    Unless it is `forgetful` nothing of it was deleted.
    """
    history.start(asyncio.get_running_loop())
    for number, name in enumerate(("one", STRANGE, "three"), 1):
        history.open_session(opened(number, name, private=number == 2)._replace(by="arrival", text=STRANGE))
        history.begin_session(number, 2**62)
        key = StreamKey(STRANGE, "request")
        for monitor in (STRANGE, "b", "B"):
            bypassed = {key: Bypass(STRANGE, 2**62)}
            history.set_monitor(number, MonitorRecord(monitor, "i", (key,), True, "sim", bypassed, 5))
        for seq in (1001, 1002):
            history.refuse(number, Refusal("b", seq, 1, 7, "bad_event", STRANGE), lambda: None)
        steps = [
            step(p, monitor="B", stream=STRANGE, violated=[p % 2], decision=Decision("deny", ("p",)))
            for p in range(1, 290 if number == 1 else 40)
        ]
        episode = Episode(3, 5, 9, 7, open=True, final=True, count=2, worst=Worst(-1.5))
        kept = [
            StoredEpisode(p, "publication", msgspec.structs.replace(episode, open=p == "p"), STRANGE)
            for p in ("p", "q")
        ]
        history.append(number, steps, lambda: None, (), kept)
        history.amend(number, "B", 3, (True, STRANGE), lambda: None)
        last = len(steps) + 1
        said = revision(last, change(2 * last - 1, 1, 1, FALSE), None, standing={1: stands(FALSE, HELD, at=steps[0])})
        history.append(number, [stored_revision(last, said)], lambda: None, [said])
        await add(history, step(last + 1, number=None), session=number)
        numbers = {"B": {STRANGE: 2**53}}
        history.save_snapshot(number, SnapshotRecord(12, {"text": [STRANGE, 0.1, None]}, 4, numbers))
    history.close_session(3, 2**62, {"id": "three", "text": STRANGE})
    if forgetful:
        await history.forget_steps(3, 6)
    await history.flush()
    await asyncio.to_thread(history.close)


def everything(end: End) -> dict[str, list[Row]]:
    """All rows; where one database has truth values, and the other 0 and 1, they are equal."""
    with closing(end):
        found = {t.name: [row for rows in end.read(*t.reading(None)) for row in rows] for t in tables()}
    return {name: sorted(rows, key=repr) for name, rows in found.items()}


def copied(source: End, target: End) -> Copied:
    with closing(source), closing(target):
        return run.copy(source, target, lambda *_, **__: None)


async def test_a_history_that_goes_to_postgresql_and_back_is_the_same(
    postgres: Postgres, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "_ROWS", 100)
    monkeypatch.setattr(run, "_CHARACTERS", 30_000)
    url, back = postgres.empty(), tmp_path / "back.sqlite"
    await fill(SqliteHistory(tmp_path), forgetful=True)
    there = copied(SqliteEnd(str(tmp_path), source=True), PostgresEnd(url))
    again = copied(PostgresEnd(url), SqliteEnd(str(back), source=False))
    rows = everything(SqliteEnd(str(tmp_path / "history.sqlite"), source=True))
    assert everything(PostgresEnd(url)) == rows == everything(SqliteEnd(str(back), source=True))
    assert there == again == Copied(sum(map(len, rows.values())), already=False)
    assert all(rows.values())
    assert back.stat().st_mode & 0o077 == 0
    for name, table in ((t.name, t) for t in tables() if t.name not in ("steps", "sessions")):
        assert all(any(row[i] is not None for row in rows[name]) for i in range(len(table.columns)))
    with closing(sqlite3.connect(back)) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)


async def test_what_postgresql_made_of_a_history_comes_whole_to_a_file(postgres: Postgres, tmp_path: Path) -> None:
    url = postgres.empty()
    await fill(PostgresHistory(url))
    copied(PostgresEnd(url), SqliteEnd(str(tmp_path), source=False))
    assert everything(PostgresEnd(url)) == everything(SqliteEnd(str(tmp_path), source=True))
    history = SqliteHistory(tmp_path)
    assert [session.id for session in await history.open_sessions()] == ["one", STRANGE]
    assert await history.closed_state("three") == {"id": "three", "text": STRANGE}
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("to", ["postgres", "sqlite"])
async def test_a_copy_that_is_killed_again_and_again_has_each_row_once(
    to: str, postgres: Postgres, tmp_path: Path
) -> None:
    source, target = tmp_path / "source", postgres.empty() if to == "postgres" else str(tmp_path / "target")
    source.mkdir()
    await fill(SqliteHistory(source))
    done = subprocess.run([sys.executable, "-c", ENDED, source, target], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    end = PostgresEnd(target) if to == "postgres" else SqliteEnd(target, source=True)
    assert everything(end) == everything(SqliteEnd(str(source), source=True))
    again = command("history", "copy", str(source), target)
    assert (again.returncode, "was copied already" in again.stdout) == (0, True), again


async def test_of_a_copy_that_was_ended_no_server_begins_with_a_part(
    postgres: Postgres, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, url, target = tmp_path / "source", postgres.empty(), tmp_path / "target"
    source.mkdir()
    await fill(SqliteHistory(source))

    def ends(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    for end, make in (
        (PostgresEnd(url), lambda: PostgresHistory(url)),
        (SqliteEnd(str(target), source=False), lambda: SqliteHistory(target)),
    ):
        with closing(SqliteEnd(str(source), source=True)) as whence, closing(end), pytest.raises(KeyboardInterrupt):
            run.copy(whence, end, ends)
        with pytest.raises(HistoryError, match=r"not all of another history.*`oracle-server history copy`"):
            make()
    with pytest.raises(HistoryError, match="not all of another history"):
        copied(PostgresEnd(url), SqliteEnd(str(tmp_path / "third"), source=False))
    # and where a server has used the source since, what is there is of another history
    await asyncio.to_thread(SqliteHistory(source).close)
    with pytest.raises(HistoryError, match=r"before a server used it; delete what is in database postgres"):
        copied(SqliteEnd(str(source), source=True), PostgresEnd(url))


async def test_a_source_that_a_server_uses_meanwhile_is_not_copied_to_its_end(
    postgres: Postgres, tmp_path: Path
) -> None:
    url = postgres.empty()
    await fill(PostgresHistory(url))
    used = False

    def use(*_: object, **__: object) -> None:
        nonlocal used
        if not used:
            used = True
            PostgresHistory(url).close()

    with (
        closing(PostgresEnd(url)) as source,
        closing(SqliteEnd(str(tmp_path), source=False)) as target,
        pytest.raises(HistoryError, match=r"a server has used database postgres at .* meanwhile"),
    ):
        run.copy(source, target, use)


Refused = Callable[[Postgres, Path], tuple[str, str]]


def _full(postgres: Postgres, folder: Path) -> tuple[str, str]:
    with closing(sqlite3.connect(folder / "history.sqlite")) as database:
        database.execute("INSERT INTO sessions (number, id, spec, text, digest, properties, private, opened) "
                         "VALUES (1, 's', 's', '', '', '[]', 0, 0)")  # fmt: skip
        database.commit()
    (folder / "other").mkdir()
    SqliteHistory(folder / "other").close()
    return str(folder / "other"), str(folder)


def _newer(postgres: Postgres, folder: Path) -> tuple[str, str]:
    url = postgres.empty()
    PostgresHistory(url).close()
    postgres.do("UPDATE format SET version = 99", url)
    return url, str(folder / "other")


def _looped(_: Postgres, folder: Path) -> tuple[str, str]:
    """From a link to itself, which nothing can be found by."""
    (folder / "loop").symlink_to("loop")
    return str(folder / "loop"), str(folder)


def _newer_target(postgres: Postgres, folder: Path) -> tuple[str, str]:
    return str(folder), _newer(postgres, folder)[0]


def _other(postgres: Postgres, folder: Path) -> tuple[str, str]:
    with closing(sqlite3.connect(folder / "other.sqlite")) as database:
        database.execute("CREATE TABLE messages (data BLOB)")
    return str(folder), str(folder / "other.sqlite")


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (_full, "has sessions already; copy .*other/history.sqlite to an empty one"),
        (_newer, r"has format 99, and this version of the server reads up to \d+: go on with the newer one"),
        (_newer_target, "has format 99, and this version of the server reads up to"),
        (_other, "other.sqlite: is a database, and no history"),
        (lambda _, folder: (str(folder / "none"), str(folder)), "none/history.sqlite: there is no history"),
        (lambda postgres, folder: (postgres.empty(), str(folder)), "there is no history in it"),
        (_looped, "loop/history.sqlite: there is no history"),
        (lambda _, folder: (str(folder), f"{folder}/history.sqlite"), "can't be copied to itself"),
    ],
)
def test_what_can_not_be_copied_is_refused(make: Refused, why: str, postgres: Postgres, tmp_path: Path) -> None:
    SqliteHistory(tmp_path).close()
    source, target = make(postgres, tmp_path)
    before = (tmp_path / "history.sqlite").read_bytes()
    with pytest.raises(OracleError, match=why):
        run.copy_history(source, target)
    assert (tmp_path / "history.sqlite").read_bytes() == before


def test_a_refusal_does_not_repeat_a_password() -> None:
    url = "postgresql://oracle:hunter2@db.example.org/oracle"
    refused = command("history", "copy", url, url)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == "oracle-server: the database: can't be copied to itself; name another place as TO\n"


async def test_what_a_server_uses_is_not_copied_and_nothing_is_copied_to_it(postgres: Postgres, tmp_path: Path) -> None:
    url = postgres.empty()
    SqliteHistory(tmp_path).close()
    history = PostgresHistory(url)
    held = PidFile(tmp_path)
    for source, target in ((url, "other"), ("other", url)):
        with pytest.raises(HistoryError, match=r"a server uses it \(.*, process \d+\); stop it"):
            run.copy_history(source, str(tmp_path / target)) if source == url else PostgresEnd(target)
    history.close()
    for words in ((tmp_path, url), (url, tmp_path)):
        refused = command("history", "copy", *map(str, words))
        assert refused.returncode == 2
        assert "another server, or an adapter with --embedded, uses this data directory; stop it" in refused.stderr
        assert refused.stderr.count("\n") == 1
    held.release()
