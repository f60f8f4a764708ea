"""The file of tokens: changed by many at once, lost, or spoilt; and which sessions a token covers."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.types import Receive, Scope, Send

from oracle_server.edge import tokens
from oracle_server.edge.access import Access
from oracle_server.edge.scopes import RouteScopes
from oracle_server.edge.tokens import Grant, TokenError, Tokens, add, listed, remove
from oracle_server.edge.transport import VISITOR
from oracle_server.sessions.runs import named
from tests.processes import PATIENCE


def test_tokens_that_come_and_go_at_once_undo_each_other_nowhere(tmp_path: Path) -> None:
    file, names = tmp_path / "tokens.json", [f"t{i}" for i in range(30)]
    add(file, "gone", ["read"])
    with ThreadPoolExecutor(8) as threads:
        making = [threads.submit(add, file, name, ["read"]) for name in names]
        removing = threads.submit(remove, file, "gone")
        assert len({made.result() for made in making}) == len(names)
        removing.result()
    assert sorted(token.name for token in listed(file)) == sorted(names)


def _make_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file, 0o600)


def _make_folder(file: Path) -> None:
    file.unlink()
    file.mkdir(0o700)


SPOILING: list[Callable[[Path], object]] = [
    lambda file: file.unlink(),
    lambda file: file.write_text("{"),
    lambda file: file.write_text('{"tokens": []}'),
    lambda file: file.chmod(0o644),
    _make_pipe,
    _make_folder,
]


@pytest.mark.parametrize("spoil", SPOILING, ids=["lost", "broken", "empty", "readable", "pipe", "folder"])
async def test_a_file_that_is_spoilt_lets_nobody_in(tmp_path: Path, spoil: Callable[[Path], object]) -> None:
    file = tmp_path / "tokens.json"
    secret = add(file, "a", ["admin"])
    known = Tokens(file)
    assert await known.grant(secret)
    spoil(file)
    assert await known.grant(secret) is None
    assert await known.grant(None) is None


async def test_others_are_served_while_a_file_is_read_and_who_asks_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, go_on, reads = tmp_path / "tokens.json", threading.Event(), list[Path]()
    gone = add(file, "gone", ["admin"])
    known = Tokens(file)
    remove(file, "gone")
    there = add(file, "there", ["read"])

    def slowly(path: Path) -> dict[str, Grant]:
        reads.append(path)
        assert go_on.wait(PATIENCE), "the event loop waits for it"
        return read(path)

    read = tokens._grants
    monkeypatch.setattr(tokens, "_grants", slowly)
    asked = [asyncio.create_task(known.grant(secret)) for secret in (gone, there, gone)]
    async with asyncio.timeout(PATIENCE):
        while not reads:
            await asyncio.sleep(0)
        assert not any(task.done() for task in asked)
        go_on.set()
        assert await asyncio.gather(*asked) == [None, Grant(frozenset({"read"})), None]
    assert len(reads) == 1


async def test_what_was_opened_ends_though_a_look_before_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, opened, ended = tmp_path / "tokens.json", asyncio.Event(), asyncio.Event()
    secret, failing = add(file, "a", ["read"]), [MemoryError()]
    visitor = SimpleNamespace(prove=lambda: True, end=ended.set, address="127.0.0.1")

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        opened.set()
        await asyncio.Future()

    async def nothing(*_: object) -> Any:
        raise AssertionError

    def read_at_last(path: Path) -> dict[str, Grant]:
        if failing:
            raise failing.pop()
        return read(path)

    read = tokens._grants
    access = Access(app, Tokens(file), RouteScopes([]))
    headers = [(b"authorization", f"Bearer {secret}".encode())]
    scope = {"type": "http", "headers": headers, "state": {VISITOR: visitor}}
    monkeypatch.setattr("oracle_server.edge.access._RECHECK", 0.0)
    async with asyncio.timeout(PATIENCE):
        tasks = [asyncio.create_task(access(scope, nothing, nothing)), asyncio.create_task(access.watch())]
        await opened.wait()
        monkeypatch.setattr(tokens, "_grants", read_at_last)
        remove(file, "a")
        await ended.wait()
    assert not failing
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def test_what_is_wrong_in_a_file_is_told_with_its_place(tmp_path: Path) -> None:
    file = tmp_path / "tokens.json"
    add(file, "a", ["read"])
    add(file, "b", ["read"])
    file.write_text(file.read_text().replace('"b"', '"b b"'))
    with pytest.raises(TokenError, match=r"tokens\.json: tokens\.1\.name: "):
        Tokens(file)
    file.write_text('{"tokens": [1]}')
    with pytest.raises(TokenError, match=r"tokens\.json: tokens\.0: "):
        Tokens(file)


def test_a_file_that_can_not_be_seen_is_not_taken_for_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a file nobody is asked for a token: one in a folder that is closed to the server is another thing."""
    file = tmp_path / "tokens.json"
    add(file, "a", ["admin"])

    def closed(path: Path, **_: object) -> os.stat_result:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "stat", closed)
    for use in (Tokens, listed):
        with pytest.raises(TokenError, match=r"tokens\.json: can't be read: Permission denied"):
            use(file)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make a file another user's")
def test_what_root_adds_can_be_read_by_the_user_whose_folder_it_is(tmp_path: Path) -> None:
    """The server, which systemd runs as a user of its own, refused all requests from then on."""
    folder = tmp_path / "data"
    folder.mkdir()
    os.chown(folder, 12345, 54321)
    file = folder / "tokens.json"
    for name in ("a", "b"):
        add(file, name, ["read"])
        found = file.stat()
        assert (found.st_uid, found.st_gid, found.st_mode & 0o777) == (12345, 54321, 0o600)
    remove(file, "a")
    assert file.stat().st_uid == 12345


def test_a_token_goes_on_where_the_server_has_its_session_go_on() -> None:
    grant = Grant(frozenset({"submit"}), sessions=frozenset({"s1", "x" * 64, "a.run2"}))
    for name in ("s1", "s1.run2", "s1.run10", "a.run2.run2"):
        assert grant.covers_session(name), name
    for name in (
        "s1.run",
        "s1.run1",
        "s1.run02",
        "s1.run2.run2x",
        "s1.runs",
        "s1.run²",
        "s11.run2",
        "S1.run2",
        ".run2",
    ):
        assert not grant.covers_session(name), name
    for own in ("s1", "x" * 64):
        assert all(grant.covers_session(named(own, run)) for run in range(1, 20))


def test_a_robots_session_at_a_centre_is_covered_by_its_own_name_alone() -> None:
    robots, own = (Grant(frozenset({"read"}), sessions=frozenset({name})) for name in ("s1@robot7", "s1"))
    assert [robots.covers_session(name) for name in ("s1@robot7", "s1.run2@robot7")] == [True, True]
    assert not any(robots.covers_session(name) for name in ("s1", "s1@robot8", "s2@robot7", "s1.run2", None))
    assert not own.covers_session("s1@robot7")


async def test_a_token_is_bound_to_a_robots_session(tmp_path: Path) -> None:
    path = tmp_path / "tokens.json"
    token = add(path, "r7", ["read"], None, ["s1@robot7"])
    assert await Tokens(path).grant(token) == Grant(frozenset({"read"}), sessions=frozenset({"s1@robot7"}))
    with pytest.raises(TokenError):
        add(path, "r8", ["read"], None, ["s1@"])
