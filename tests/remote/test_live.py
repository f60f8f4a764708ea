"""The oracles of a live session: whatever goes wrong with one, what waits for it is judged."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.engines.table import make_engines
from oracle_server.remote import oracle
from oracle_server.remote.live import Oracles as Live
from oracle_server.sessions.judgements import Judgements
from oracle_server.specfiles.load import parse_spec
from tests.remote.conftest import Director, Oracles, spec
from tests.whole.harness import PATIENCE, run


class Asked:
    """A session of which each event is asked about at an oracle."""

    def __init__(self, url: str) -> None:
        ready = plan(parse_spec(spec("x", url), "x.yaml").spec)
        self._core = Session(ready, make_engines(ready))
        self._judgements = Judgements()
        self.oracles = Live(self._core, time.time_ns, lambda judging: self._judgements.note(judging()))

    async def judged(self, seq: int) -> str:
        """What is said of an event."""
        with self._judgements.of("m", seq) as judgement:
            self._core.ingest(Event(StreamKey("/a", "topic"), "m", seq, None, time.time_ns(), {"v": 1}))
            self.oracles.ask()
            assert self.oracles.is_waited_for("m", seq)
            (judged,) = await asyncio.wait_for(judgement.whole(), PATIENCE)
        return judged.verdicts[0].outcome.value


def failing_once(call: Callable[..., Any]) -> Callable[..., Any]:
    """A function that has a bug when it is called first."""
    bugs = [RuntimeError("a bug")]

    def called(*arguments: Any, **options: Any) -> Any:
        if bugs:
            raise bugs.pop()
        return call(*arguments, **options)

    return called


@pytest.mark.parametrize("broken", ["connected", "read_reply"])
async def test_a_bug_is_logged_and_later_questions_are_asked(
    oracles: Oracles,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    broken: str,
) -> None:
    monkeypatch.setattr(oracle, broken, failing_once(getattr(oracle, broken)))
    asked = Asked(oracles.url("prolog"))
    assert await asked.judged(1) == "unknown"
    async with asyncio.timeout(PATIENCE):
        for seq in count(2):  # it is looked for about once a second
            outcome = await asked.judged(seq)
            if outcome != "unknown":
                break
    assert outcome == "currently_true"
    await asked.oracles.settle()
    assert "RuntimeError: a bug" in capsys.readouterr().out


async def test_what_a_replay_logs_is_not_in_its_report(director: Director, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(spec("x", director.url), encoding="utf-8")
    (tmp_path / "log.jsonl").write_text('{"topic": "a", "time": 1.5, "v": 1}\n', encoding="utf-8")
    replaying = asyncio.to_thread(run, "replay", "--json", tmp_path / "x.yaml", tmp_path / "log.jsonl")
    task = asyncio.create_task(replaying)
    connection, _ = await director.asked()
    await director.say(connection, None)
    ended = await task
    lines = [json.loads(line) for line in ended.stdout.split("\n")[:-1]]
    assert lines[0]["outcome"] == "unknown"
    assert "an oracle fails" in ended.stderr
