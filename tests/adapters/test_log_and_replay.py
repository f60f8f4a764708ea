"""An offline monitor's log, and what `replay` makes of it."""

from __future__ import annotations

import json
import os
import resource
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracle_adapter import LinkError, LogFile, open_log
from oracle_adapter.fields import nanoseconds

from oracle_server.core.stamps import nanoseconds as as_the_server_reads_it
from tests.whole.harness import run

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "specs" / "battery_uav.yaml"
TRACE = ROOT / "examples" / "battery_uav" / "traces" / "fault_wrong_status.jsonl"


@pytest.fixture(scope="module")
def streams(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("streams") / "streams.json"
    ended = run("streams", SPEC)
    assert (ended.returncode, ended.stderr) == (0, "")
    path.write_text(ended.stdout, encoding="utf-8")
    return path


def log_at(path: Path, streams: Path, errors: list[LinkError] | None = None) -> LogFile:
    found: list[LinkError] = [] if errors is None else errors
    return open_log(str(path), str(streams), "uav1", lambda state, detail: None, found.append)


def test_streams_are_observed_and_none_is_filtered(streams: Path, tmp_path: Path) -> None:
    log = log_at(tmp_path / "log.jsonl", streams)
    attached = log.wait_attached()
    log.close()
    assert (attached.spec, attached.monitor) == ("battery_uav", "uav1")
    assert {s["action"] for s in attached.streams} == {"log"}
    assert ("/SetLED", "/SetLED_mon") in {(s["name"], s.get("proxy")) for s in attached.streams}


def lines_of(path: Path) -> list[dict[str, Any]]:
    """The values of a file of JSON Lines."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").split("\n") if line]


def test_a_clock_that_goes_back_is_in_the_log_and_replay_says_so(streams: Path, tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    log = log_at(path, streams)
    log.renew(list)  # before the first event nothing goes back
    for stamp in (5, 6):
        log.send("/battery_percentage", "topic", stamp, {"id": 1, "percentage": 90.0})
    log.renew(list)
    for stamp in (1, 2):
        log.send("/battery_percentage", "topic", stamp, {"id": 1, "percentage": 90.0})
    log.close()
    assert [line.get("back") for line in lines_of(path)] == [None, None, True, None]
    told = run("replay", SPEC, path)
    assert f"{path}:3: simulated time went back (1 time in all)" in told.stdout + told.stderr


def test_time_goes_on_in_a_log_where_the_machines_clock_is_set_back(
    streams: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stood still until the clock was there again: whatever was silent meanwhile counted as just heard."""
    wall, ticks = 1_764_000_000 * 10**9, 5 * 10**9
    log = log_at(tmp_path / "log.jsonl", streams)
    for passed, at in ((0, 0), (2, 2), (1, -1800), (1, -1799), (1800, 1), (1, 1900)):
        ticks += passed * 10**9
        monkeypatch.setattr(time, "monotonic_ns", partial(int, ticks))
        monkeypatch.setattr(time, "time_ns", partial(int, wall + at * 10**9))
        log.send("/battery_percentage", "topic", None, {"id": 1, "percentage": 90.0})
    log.close()
    arrived = [(line["arrived"] - wall) // 10**9 for line in lines_of(tmp_path / "log.jsonl")]
    assert arrived == [0, 2, 3, 4, 1804, 1900]


def test_an_event_of_an_action_names_its_goal(streams: Path, tmp_path: Path) -> None:
    log = log_at(tmp_path / "log.jsonl", streams)
    log.send("/dock", "reply", 5, {"accepted": True}, call=3, goal_id="9f2c", status="accepted")
    log.close()
    [line] = lines_of(tmp_path / "log.jsonl")
    assert (line["kind"], line["call"], line["goal_id"], line["status"]) == ("reply", 3, "9f2c", "accepted")


def test_a_log_is_judged_as_the_events_were_told(streams: Path, tmp_path: Path) -> None:
    events: list[dict[str, Any]] = lines_of(TRACE)
    log = log_at(tmp_path / "log.jsonl", streams)
    log.start()
    for event in events:
        stamp = event["stamp"]
        assert log.send(event["stream"], event["kind"], partial(int, stamp), event["data"], call=event.get("call"))
    assert (log.stats().sent, log.stats().lost) == (len(events), 0)
    log.close()
    lines = lines_of(tmp_path / "log.jsonl")
    assert [line["data"] for line in lines] == [event["data"] for event in events]
    assert [line["arrived"] for line in lines] == sorted(line["arrived"] for line in lines)
    ended = run("replay", SPEC, tmp_path / "log.jsonl", "--json")
    assert ended.returncode == 1
    properties = json.loads(ended.stdout.rstrip("\n").rpartition("\n")[2])["summary"]["properties"]
    assert {name for name, p in properties.items() if p["violations"]} == {"status_matches_percentage"}


def test_a_log_goes_on_behind_what_is_there_and_takes_bytes_and_what_is_no_number(
    streams: Path, tmp_path: Path
) -> None:
    for value in (b"\x01\x02", float("nan")):
        log = log_at(tmp_path / "log.jsonl", streams)
        log.send("/a", "topic", None, {"v": value})
        log.close()
    values = [line["data"]["v"] for line in lines_of(tmp_path / "log.jsonl")]
    assert values == ["AQI=", "NaN"]


def test_many_threads_write_whole_lines_in_order(streams: Path, tmp_path: Path) -> None:
    log = log_at(tmp_path / "log.jsonl", streams)

    def speak(number: int) -> None:
        for i in range(200):
            log.send(f"/{number}", "topic", i, {"v": i})

    threads = [threading.Thread(target=speak, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    log.close()
    lines = lines_of(tmp_path / "log.jsonl")
    assert [line["seq"] for line in lines] == list(range(1, 801))
    for number in range(4):
        assert [line["stamp"] for line in lines if line["stream"] == f"/{number}"] == list(range(200))


def test_a_full_disk_is_told_once_and_counted(streams: Path) -> None:
    errors: list[LinkError] = []
    log = log_at(Path("/dev/full"), streams, errors)
    assert [log.send("/a", "topic", None, {"v": 1}) for _ in range(3)] == [False] * 3
    assert log.stats().lost == 3
    (error,) = errors
    assert "No space left" in str(error)
    assert not error.fatal
    log.close()


def test_what_a_full_disk_did_not_take_is_told_by_the_next_line(streams: Path, tmp_path: Path) -> None:
    """What waited in a buffer was written later, up to some point, and what was missing was told by nothing."""
    path, errors = tmp_path / "log.jsonl", list[LinkError]()
    log = log_at(path, streams, errors)

    def send(stamp: int) -> bool:
        return log.send("/battery_percentage", "topic", stamp, {"id": stamp, "percentage": 90.0}, lost=1)

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    for first in (1, 101):
        assert send(first)
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 50, before[1]))
        try:
            assert not any(send(stamp) for stamp in range(first + 1, first + 100))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert send(201)
    log.close()
    assert [(line["seq"], line["lost"]) for line in lines_of(path)] == [(1, 1), (101, 199), (201, 199)]
    assert ["File too large" in str(error) for error in errors] == [True, True]
    told = run("replay", SPEC, path)
    assert "399 events lost while it was recorded" in told.stdout + told.stderr


def test_a_log_that_ends_within_a_line_goes_on_with_the_next(streams: Path, tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    path.write_text('{"stream": "/a", "da', encoding="utf-8")
    log = log_at(path, streams)
    for stamp in (1, 2):
        log.send("/a", "topic", stamp, {})
    log.close()
    assert [json.loads(line)["stamp"] for line in path.read_text(encoding="utf-8").splitlines()[1:]] == [1, 2]


@pytest.mark.parametrize("content", ["", "[]", '{"spec": "x"}', '{"streams": [5], "spec": "x", "spec_digest": "y"}'])
def test_what_are_no_streams_is_refused_in_words(content: str, tmp_path: Path) -> None:
    (tmp_path / "streams.json").write_text(content, encoding="utf-8")
    with pytest.raises(ValueError, match="--streams"):
        log_at(tmp_path / "log.jsonl", tmp_path / "streams.json")
    with pytest.raises(ValueError, match="--streams"):
        log_at(tmp_path / "log.jsonl", tmp_path / "nothing.json")


def test_a_log_that_can_not_be_written_is_refused(streams: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--log"):
        log_at(tmp_path / "nowhere" / "log.jsonl", streams)


@given(st.integers(-(2**64), 2**64) | st.floats())
def test_a_number_is_the_same_time_to_adapter_and_server(seconds: float) -> None:
    assert nanoseconds(seconds) == as_the_server_reads_it(seconds)


def test_a_fifo_that_nobody_reads_is_not_waited_for(streams: Path, tmp_path: Path) -> None:
    path = tmp_path / "log"
    os.mkfifo(path)
    with pytest.raises(ValueError, match="can't be written: it is a FIFO that nobody reads yet"):
        log_at(path, streams)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    log = log_at(path, streams)
    assert log.send("/a", "topic", 1, {})
    assert log.close()
    assert json.loads(os.read(reader, 1000))["stream"] == "/a"
    os.close(reader)
