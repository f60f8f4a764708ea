"""The process that forwards a robot's history: what it waits for, and what it tells."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from oracle_server.history.forwarding import centre
from oracle_server.history.sqlite.history import NAME
from oracle_server.jobs import forwarding
from tests.history.forwarded import ORIGIN, at_the_centre, at_the_robot, robot
from tests.history.making import add, opened, step
from tests.postgres import Postgres
from tests.processes import PATIENCE


async def until(good: Callable[[], Any]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not good():
            await asyncio.sleep(0.01)


async def test_a_centre_that_is_away_is_waited_for(
    postgres: Postgres, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forwarding, "_LONGEST", 0.1)
    monkeypatch.setattr(forwarding, "_IDLE", 0.05)
    url = postgres.empty()
    async with robot(tmp_path) as history:
        assert history.forwarding is not None
        history.open_session(opened(1, "one"))
        forwards = forwarding.Forwarding(history.forwarding, url, ORIGIN)
        running = asyncio.create_task(forwards.run())
        await until(lambda: forwards.progress.left == 0)
        await asyncio.to_thread(postgres.stop)
        try:
            await until(lambda: forwards.progress.trouble)
            await add(history, *(step(p) for p in range(1, 50)))
        finally:
            await asyncio.to_thread(postgres.start)
        await until(lambda: forwards.progress.rows >= 50 and forwards.progress.trouble is None)
        running.cancel()
        await asyncio.wait([running])
        forwards.close()
        assert at_the_centre(url)["steps"] == at_the_robot(tmp_path)["steps"]
    log = capsys.readouterr().out
    assert log.count("can't be forwarded now") == 1
    assert log.count("the history is forwarded") == 2
    assert "Traceback" not in log


async def test_while_the_centre_is_away_it_is_told_how_far_behind_it_is(
    postgres: Postgres, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forwarding, "_LONGEST", 0.1)
    monkeypatch.setattr(forwarding, "_IDLE", 0.05)
    monkeypatch.setattr(centre, "_ASKED_EVERY", 0.0)
    url = postgres.empty()
    async with robot(tmp_path) as history:
        assert history.forwarding is not None
        for number, name in ((1, "one"), (2, "two")):
            history.open_session(opened(number, name))
            await add(history, *(step(p) for p in range(1, 11)), session=number)
        forwards = forwarding.Forwarding(history.forwarding, url, ORIGIN)
        running = asyncio.create_task(forwards.run())
        async with asyncio.timeout(PATIENCE):
            while await history.forwarding.behind() != (0, None):
                await asyncio.sleep(0.01)
        await asyncio.to_thread(postgres.stop)
        try:
            await until(lambda: forwards.progress.trouble)
            await add(history, *(step(p) for p in range(11, 31)), session=2)
            await history.forget_steps(1, 5)
            await until(lambda: forwards.progress.oldest is not None)
            assert forwards.progress.oldest == step(11).judged
            assert forwards.progress.left is not None
            assert forwards.progress.left >= 20, "and blocks that have changed with them"
        finally:
            await asyncio.to_thread(postgres.start)
        await until(lambda: forwards.progress.trouble is None)
        await until(lambda: (forwards.progress.left, forwards.progress.oldest) == (0, None))
        running.cancel()
        await asyncio.wait([running])
        forwards.close()


async def test_while_nothing_can_be_kept_here_the_centre_hears_nothing(
    postgres: Postgres, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would take silence for a robot that is well and has nothing to tell."""
    monkeypatch.setattr(forwarding, "_LONGEST", 0.1)
    monkeypatch.setattr(forwarding, "_IDLE", 0.05)
    async with robot(tmp_path) as history:
        assert history.forwarding is not None
        history.open_session(opened(1, "one"))
        forwards = forwarding.Forwarding(history.forwarding, postgres.empty(), ORIGIN)
        running = asyncio.create_task(forwards.run())
        while not (await history.forwarding.stands()).seq:
            await asyncio.sleep(0.01)
        with closing(sqlite3.connect(tmp_path / NAME, isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            history.append(1, [step(1)], lambda: None)
            await until(lambda: history.failure)
            await until(lambda: forwards.progress.trouble)
            assert forwards.progress.trouble == f"the history here can't be written: {history.failure}"
        await until(lambda: forwards.progress.rows >= 2 and forwards.progress.trouble is None)
        running.cancel()
        await asyncio.wait([running])
        forwards.close()


def _is_done(progress: forwarding.Progress) -> bool:
    return progress.left == 0


async def test_the_second_of_two_robots_of_one_name_is_warned(
    postgres: Postgres, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = postgres.empty()
    for disk, warned in (("first", False), ("second", True), ("second", True), ("third", False)):
        (tmp_path / disk).mkdir(exist_ok=True)
        if disk == "third":
            postgres.do("UPDATE origins SET heard = heard - interval '4 minutes'", url)
        async with robot(tmp_path / disk) as history:
            assert history.forwarding is not None
            forwards = forwarding.Forwarding(history.forwarding, url, ORIGIN)
            running = asyncio.create_task(forwards.run())
            await until(partial(_is_done, forwards.progress))
            running.cancel()
            await asyncio.wait([running])
            forwards.close()
        assert ("another history was forwarded by this name" in capsys.readouterr().out) is warned, disk
