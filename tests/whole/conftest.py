"""Servers for the tests: one for all those that only want some server, and fresh ones."""

from __future__ import annotations

import asyncio
import inspect
import re
import shutil
import sys
import threading
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import Protocol

import pytest

from tests.whole.client import attached, make_clock, make_event
from tests.whole.harness import PATIENCE, Server

SPECS = (Path(__file__).parent / "specs", Path(__file__).parents[1] / "vectors" / "specs")


class Starts(Protocol):
    """Starts a server on the test's own folders, the same each time; settings as in the environment."""

    def __call__(self, **settings: str) -> Server: ...


def copy_specs(target: Path, only: Collection[str] | None = None) -> Path:
    """Copy the tests' specs, or those of some ids, to a folder that is made for them."""
    target.mkdir()
    paths = [path for folder in SPECS for path in folder.glob("*.yaml") if only is None or path.stem in only]
    assert only is None or {path.stem for path in paths} == set(only)
    for path in paths:
        shutil.copy(path, target)
    return target


@pytest.fixture(scope="session")
def shared_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("server")
    running = Server(copy_specs(folder / "specs"), folder / "data", ORACLE_HISTORY="memory")
    with running:
        yield running


@pytest.fixture
def server(shared_server: Server) -> Iterator[Server]:
    """A server that tests share; each takes session names of its own."""
    yield shared_server
    assert shared_server.alive
    shared_server.check_log()


@pytest.fixture(scope="session")
def name() -> Callable[[], str]:
    """Session names that no other test has taken."""
    numbers = count(1)
    return lambda: f"session-{next(numbers)}"


@pytest.fixture
def session(name: Callable[[], str]) -> str:
    """A session name of the test's own."""
    return name()


def named_specs(module: ModuleType) -> set[str]:
    """The ids of the tests' specs that a module's text has, or that of another one of the tests that it imports from.

    To read all of them takes a server longer than the rest of its start.
    """
    theirs = {getattr(value, "__module__", None) for value in vars(module).values()}
    modules = [module, *(sys.modules[name] for name in theirs if name is not None and name.startswith("tests."))]
    words = {word for each in modules for word in re.findall(r"\w+", inspect.getsource(each))}
    return words & {path.stem for folder in SPECS for path in folder.glob("*.yaml")}


@pytest.fixture
def start(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Starts]:
    """Starts servers of the test's own, one after the other, over the same history; with the specs that it names."""
    specs = copy_specs(tmp_path / "specs", named_specs(request.module))
    with ExitStack() as servers:

        def started(**settings: str) -> Server:
            return servers.enter_context(Server(specs, tmp_path / "data", **settings))

        yield started


@pytest.fixture
def bystander(server: Server, name: Callable[[], str]) -> Iterator[None]:
    """Another session on the same server, which is answered all the time, and right."""
    session, started, stop = name(), threading.Event(), threading.Event()

    async def ask() -> int:
        async with attached(server, "lamp1", session=session, spec="lamp", streams=["/light", "/switch"]) as monitor:
            await monitor.send(make_clock("/switch", 10**9, "response"))
            seq = 0
            last_round = False
            while not last_round:
                last_round = stop.is_set()
                level = 3 if seq % 4 == 0 else 300
                await monitor.send(make_event(seq + 1, "/light", seq, {"level": level}), make_clock("/light", seq + 2))
                request = {"stream": "/switch", "kind": "request", "data": {"switch_on": True}, "call": seq}
                decision = await monitor.ask(seq + 2, at=seq + 1, **request)
                assert decision["decision"] == ("allow" if level == 3 else "deny")
                seq += 2
                started.set()
            await monitor.detach()
        return seq

    with ThreadPoolExecutor(1) as threads:  # with a loop of its own, so that it is awake whatever the test does
        asking = threads.submit(asyncio.run, ask())
        try:
            assert started.wait(PATIENCE)
            yield
        finally:
            stop.set()
        asked = asking.result(PATIENCE)
    records = server.records(session, property="only_in_the_dark")
    assert [r["seq"] for r in records] == list(range(1, asked + 1))
    assert [r["decision"] for r in records[1::2]] == (["allow", "deny"] * asked)[: asked // 2]
