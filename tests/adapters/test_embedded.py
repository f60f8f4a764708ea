"""An oracle in the adapter's own process: judges as a server does, keeps the same history, outlives kills."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
import random
import re
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
import structlog
from oracle_adapter import Answer, Link, LinkError
from oracle_adapter.embedded import EmbeddedLink
from structlog.testing import capture_logs

from oracle_server.core.formula.render import render
from oracle_server.core.session import Session
from oracle_server.replay.command import run_replay
from tests.generate import KEYS, formula, trace
from tests.processes import PATIENCE, ROOT, Process, environment
from tests.whole.conftest import Starts
from tests.whole.harness import Server

SINGLE = ROOT / "tests" / "whole" / "specs" / "single.yaml"
STAMP = 1_732_147_200 * 10**9
TIMES = {"arrived", "judged"}
LOAD = """
import os, sys
from oracle_adapter import should_pass
from oracle_adapter.embedded import EmbeddedLink

def say(*words):  # a line of its own, whatever the log is in the midst of
    os.write(1, ("\\n" + " ".join(map(str, words)) + "\\n").encode())

link = EmbeddedLink(sys.argv[1], sys.argv[2], "m1", session="s", streams=["/a"])
link.start()
link.wait_attached(60)
first = int(sys.argv[3])
for n in range(first, first + 10**6):
    answer = link.ask("/a", "topic", None, {"v": n}, decide_within=60).result(60)
    passed, why = should_pass(answer, on_unavailable="deny")
    say("did", n, answer.why, passed)
    link.handled(answer, passed, why)
    if n % 40 == 0:  # cut off: what is not acked is sent again
        link._keeper._oracle._loop.call_soon_threadsafe(link._keeper._line._close, "cut")
    if n % 10 == 0:
        say("acked", first + link.stats().acked, link.stats().reconnects)
"""
GUARDED = """
id: guarded
ordering: {max_delay: none}
streams:
  - {topic: /a, action: filter, signals: {v: msg.v, odd: msg.v % 2 == 1}}
  - {topic: /free, signals: {w: msg.w}}
properties:
  - {id: even, formula: 'not {topic: "/a", odd}', guards: [/a]}
"""

WATCHED = """
id: watched
ordering: {max_delay: 20ms}
streams:
  - {topic: /a, action: filter, signals: {v: msg.v}}
  - {topic: /b}
properties:
  - {id: heard, time: seconds, formula: '{topic: "/a"} -> once[:1h] {topic: "/b"}', guards: [/a]}
"""


def random_spec(rng: random.Random, folder: Path, name: str) -> Path:
    formulas = [render(formula(rng, "steps", 3)) for _ in range(3)]
    lines = [f"  - {{id: p{i}, formula: {text!r}}}" for i, text in enumerate(formulas)]
    lines[0] = lines[0][:-1] + ", guards: [/a]}"
    signals = ", ".join(f"{key}: msg.{key}" for key in KEYS)
    head = f"id: {name}\nordering: {{max_delay: none}}\nstreams:\n"
    head += f"  - {{topic: /a, action: filter, signals: {{{signals}}}}}\nproperties:"
    path = folder / f"{name}.yaml"
    path.write_text("\n".join([head, *lines, ""]))
    return path


def guarded(folder: Path) -> Path:
    path = folder / "guarded.yaml"
    path.write_text(GUARDED)
    return path


def plain(record: dict[str, Any]) -> dict[str, Any]:
    """A record without what the wall clock says."""
    return {key: value for key, value in record.items() if key not in TIMES}


def ask_all(link: Link, steps: Sequence[tuple[int, Mapping[str, Any]]]) -> list[tuple[Any, ...]]:
    """What is decided, with its verdicts."""
    with link:
        link.wait_attached(PATIENCE)
        asked = [link.ask("/a", "topic", at, dict(data), decide_within=PATIENCE) for at, data in steps]
        said = [one.result(PATIENCE) for one in asked]
        for answer in said:
            link.handled(answer, answer.decision == "allow", "decision")
        assert link.close(PATIENCE)
    return [(answer.why, answer.decision, answer.denied_by, answer.verdicts) for answer in said]


def test_an_ask_is_judged_and_answered_in_the_thread_that_asks(tmp_path: Path) -> None:
    answers: list[tuple[Answer, int]] = []
    come = threading.Event()

    def answered(answer: Answer) -> None:
        answers.append((answer, threading.get_ident()))
        come.set()

    with EmbeddedLink(str(SINGLE), str(tmp_path), "m1", streams=["/a"]) as link:
        link.wait_attached(PATIENCE)
        for i in range(50):
            come.clear()
            link.ask_then("/a", "topic", STAMP + i, {"v": i}, answered, decide_within=PATIENCE)
            assert come.wait(PATIENCE)
    assert {answer.why for answer, _ in answers} == {"decision"}
    assert threading.get_ident() in {thread for _, thread in answers}


def replayed(spec: Path, trace: Path) -> list[tuple[Any, ...]]:
    with contextlib.redirect_stdout(io.StringIO()) as told:
        run_replay([spec], trace, None, "jsonl")
    records = [json.loads(line) for line in told.getvalue().splitlines()]
    return judged(record for record in records if "outcome" in record)


def judged(records: Iterable[Mapping[str, Any]]) -> list[tuple[Any, ...]]:
    keys = ("step", "property", "outcome", "violation", "seq", "decision")
    return [tuple(record[key] for key in keys) for record in records]


def test_verdicts_records_and_decisions_are_those_of_a_server_and_of_replay(start: Starts, tmp_path: Path) -> None:
    rng, specs, here = random.Random(24), tmp_path / "specs", tmp_path / "here"
    names = ("drawn1", "drawn2", "drawn3")
    cases = {name: (random_spec(rng, specs, name), trace(rng, 40)) for name in names}
    server = start()
    for name, (spec, steps) in cases.items():
        through = ask_all(Link(server.url, "m1", spec=name, session=name, streams=["/a"]), steps)
        assert ask_all(EmbeddedLink(str(spec), str(here), "m1", session=name, streams=["/a"]), steps) == through
        assert {why for why, *_ in through} == {"decision"}
    decisions = set()
    with Server(specs, here) as reader:  # the same files are a server's
        for name, (spec, steps) in cases.items():
            kept, those = reader.records(name), server.records(name)
            assert [plain(record) for record in kept] == [plain(record) for record in those]
            assert len(kept) == 3 * len(steps)
            file = tmp_path / f"{name}.jsonl"
            events = ({"stream": "/a", "stamp": at, "data": data, "ask": True} for at, data in steps)
            lines = [json.dumps({"seq": seq, "kind": "topic", **event}) for seq, event in enumerate(events, 1)]
            file.write_text("\n".join([*lines, ""]))
            assert replayed(spec, file) == judged(kept)
            decisions |= {record["decision"] for record in kept}
    assert decisions == {"allow", "deny"}


def test_a_data_directory_has_one_user(tmp_path: Path) -> None:
    with EmbeddedLink(str(SINGLE), str(tmp_path), "m1", streams=["/a"]) as link:
        link.wait_attached(PATIENCE)
        with pytest.raises(LinkError, match="another server, or an adapter with --embedded, uses"):
            EmbeddedLink(str(SINGLE), str(tmp_path), "m2", streams=["/a"])


def test_what_the_file_says_now_is_judged_by_where_a_session_began_by_another_text(tmp_path: Path) -> None:
    spec, data = guarded(tmp_path), tmp_path / "data"
    said: list[object] = []

    def asked(v: int) -> str | None:
        with EmbeddedLink(str(spec), str(data), "m1", session="s", streams=["/a"], on_error=said.append) as link:
            link.wait_attached(PATIENCE)
            return link.ask("/a", "topic", None, {"v": v}, decide_within=PATIENCE).result(PATIENCE).decision

    assert asked(2) == "allow"
    spec.write_text(GUARDED + "# a remark means nothing\n")
    with capture_logs() as logs:
        assert asked(4) == "allow"
    assert not [log for log in logs if log["log_level"] == "warning"]
    assert not said
    spec.write_text(GUARDED.replace("msg.v % 2 == 1", "msg.v > 1"))
    with capture_logs() as logs:
        assert [asked(v) for v in (4, 1)] == ["deny", "allow"]
    assert [(log["session"], log["reason"]) for log in logs if "another run" in log["event"]] == [
        ("s", "its spec was changed")
    ]
    assert any("its spec was changed; attach to s.run2" in str(error) for error in said)


@pytest.mark.parametrize(("ahead_by", "bound"), [(48 * 3600, "1h"), (1800, "10ms")])
def test_after_the_machines_clock_was_set_back_a_session_goes_on_by_that(
    ahead_by: int, bound: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All was late, and stood at the time that had been reached: what was silent for days counted as just heard."""
    spec, data, said = tmp_path / "watched.yaml", tmp_path / "data", list[object]()
    spec.write_text(WATCHED.replace("1h", bound))
    now = time.time_ns

    def asked(*heard: str) -> str | None:
        words = (str(spec), str(data), "m1")
        with EmbeddedLink(*words, session="s", streams=["/a", "/b"], on_error=said.append) as link:
            link.wait_attached(PATIENCE)
            at = time.time_ns()
            for stream in heard:
                link.send(stream, "topic", at, {})
            return link.ask("/a", "topic", at, {"v": 2}, decide_within=PATIENCE).result(PATIENCE).decision

    with monkeypatch.context() as ahead:
        ahead.setattr(time, "time_ns", lambda: now() + ahead_by * 10**9)
        assert asked("/b") == "allow"
    assert [asked(), asked("/b")] == ["deny", "allow"]
    assert any("the machine's clock was set back; attach to s.run2" in str(error) for error in said)


def test_a_spec_that_is_refused_is_told(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"nowhere\.yaml.*can't be read"):
        EmbeddedLink(str(tmp_path / "nowhere.yaml"), str(tmp_path), "m1")


def test_after_a_kill_all_that_was_acked_is_kept_once_and_as_it_was_done(start: Starts, tmp_path: Path) -> None:
    spec, data = guarded(tmp_path), tmp_path / "data"  # where `start` has it
    runs = []
    for first in (10**6, 2 * 10**6):
        words = (sys.executable, "-c", LOAD, spec, data, first)
        loaded = Process("adapter", words, environment())
        try:
            loaded.said(r"acked \d+ [1-9]\n(?:.*\n){60}")
        finally:
            loaded.end(signal.SIGKILL)
        done = dict(re.findall(r"^did (\d+) decision (\w+)$", loaded.log, re.MULTILINE))
        assert len(done) == len(re.findall("^did ", loaded.log, re.MULTILINE))
        runs.append((first, done, int(re.findall(r"^acked (\d+) ", loaded.log, re.MULTILINE)[-1])))
    lines = start().http.get("/api/v1/sessions/s/trace").text.splitlines()
    kept = [line for line in map(json.loads, lines) if "seq" in line]
    assert [line["seq"] for line in kept] == list(range(1, len(kept) + 1))
    numbers = [line["signals"]["v"] for line in kept]
    found = {line["signals"]["v"]: line for line in kept}
    for first, done, acked in runs:
        mine = [number for number in numbers if first <= number < first + 10**6]
        assert mine == list(range(first, first + len(mine)))  # each once, from the first on
        assert first < acked <= first + len(mine)
        assert len(mine) <= len(done) + 1  # the last may have been judged and not told
        for number in mine:
            passed = done.get(str(number))
            assert found[number]["decision"] == ("deny" if number % 2 else "allow")
            assert passed in (None, str(number % 2 == 0))
            if found[number].get("passed") is not None:
                assert str(found[number]["passed"]) == passed
    assert len(numbers) == len(set(numbers))


class Slow:
    """A session whose steps compute for as long as a test wants."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.go_on, self.begun = threading.Event(), threading.Event()
        self.go_on.set()
        plainly = Session.ingest

        def ingest(session: Session, *arguments: Any, **more: Any) -> Any:
            self.begun.set()
            while not self.go_on.is_set():
                sum(range(1000))
            return plainly(session, *arguments, **more)

        monkeypatch.setattr(Session, "ingest", ingest)

    def stand(self) -> None:
        """The next step does not end until `go_on` is set."""
        self.go_on.clear()
        self.begun.clear()


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Iterator[Slow]:
    made = Slow(monkeypatch)
    yield made
    made.go_on.set()


def test_a_slow_step_keeps_neither_deadlines_nor_what_comes_meanwhile(slow: Slow, tmp_path: Path) -> None:
    link = EmbeddedLink(str(guarded(tmp_path)), str(tmp_path / "own"), "m1", session="s", streams=["/a", "/free"])
    with link:
        link.wait_attached(PATIENCE)
        slow.stand()
        first: list[Answer] = []
        answered = threading.Event()

        def told(answer: Answer) -> None:
            first.append(answer)
            answered.set()

        def ask() -> None:
            link.ask_then("/a", "topic", STAMP, {"v": 2}, told, decide_within=0.1)

        asking = threading.Thread(target=ask)
        asking.start()
        assert slow.begun.wait(PATIENCE)
        assert answered.wait(PATIENCE)  # by its deadline, and the step still goes on
        assert first[0].why == "timeout"
        assert link.send("/free", "topic", STAMP + 1, {"w": 1})
        link.clock([("/free", "topic", STAMP + 3)])
        assert link.ask("/a", "topic", STAMP + 2, {"v": 2}, decide_within=0.1).result(PATIENCE).why == "timeout"
        slow.go_on.set()
        asking.join(PATIENCE)
        assert link.ask("/a", "topic", STAMP + 3, {"v": 3}, decide_within=PATIENCE).result(PATIENCE).decision == "deny"
        slow.stand()  # from now on no thread of the adapter is kept
        late = link.ask("/a", "topic", STAMP + 4, {"v": 4}, decide_within=0.1)
        assert slow.begun.wait(PATIENCE)
        assert link.send("/free", "topic", STAMP + 5, {"w": 1})
        link.clock([("/free", "topic", STAMP + 5)])
        assert late.result(PATIENCE).why == "timeout"
        slow.go_on.set()
        assert link.close(PATIENCE)
        assert link.stats().acked == 6


def test_closing_does_not_wait_for_ever(slow: Slow, tmp_path: Path) -> None:
    words = (str(guarded(tmp_path)), str(tmp_path / "own"), "m1")
    link = EmbeddedLink(*words, session="s", streams=["/a"])
    link.start()
    link.wait_attached(PATIENCE)
    slow.stand()
    link.send("/a", "topic", STAMP, {"v": 2})
    assert slow.begun.wait(PATIENCE)
    assert not link.close(0.1)
    with pytest.raises(LinkError, match="uses this data directory"):
        EmbeddedLink(*words)
    slow.go_on.set()
    link.close(PATIENCE)
    with EmbeddedLink(*words, session="s", streams=["/a"]) as again:
        again.wait_attached(PATIENCE)


def test_a_full_disk_denies_and_is_told_and_loses_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "own"
    link = EmbeddedLink(str(guarded(tmp_path)), str(folder), "m1", session="s", streams=["/a"])
    asked = itertools.count(1)

    def until(decision: str) -> Answer:
        while True:
            answer = link.ask("/a", "topic", None, {"v": 2}, decide_within=PATIENCE).result(PATIENCE)
            next(asked)
            if answer.decision == decision:
                return answer

    with capture_logs() as logs, link:
        link.wait_attached(PATIENCE)
        until("allow")
        # SQLite then tells what it does of a full disk
        database = link._oracle._history.store.database
        database.execute("PRAGMA max_page_count = 1")
        assert until("deny").verdicts == {"even": "unknown"}
        assert "database or disk is full" in [line.get("reason") for line in logs]
        database.execute("PRAGMA max_page_count = 1000000")
        until("allow")
        assert link.close(PATIENCE)
        assert link.stats().acked == next(asked) - 1


def test_nothing_of_the_process_is_changed(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        configured = structlog.get_config()
        with EmbeddedLink(str(SINGLE), str(tmp_path / "own"), "m1", streams=["/a"]) as link:
            link.wait_attached(PATIENCE)
            modes = {path.name: path.stat().st_mode & 0o777 for path in (tmp_path / "own").iterdir() if path.is_file()}
            assert structlog.get_config() == configured
        assert set(modes.values()) == {0o600}, modes
        assert os.umask(0o022) == 0o022
    finally:
        os.umask(before)
