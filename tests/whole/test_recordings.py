"""Recordings that are sent to a server, and judged there as sessions of their own."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin

from oracle_server.edge.tokens import add
from oracle_server.replay.files.mcapfile import MAGIC as MCAP
from tests.replay.writing import SPEC, write_ros1, write_ros2
from tests.whole.client import attached, make_clock, make_event
from tests.whole.conftest import SPECS, Starts
from tests.whole.harness import Server, problem, run

ROUNDS = 30
BEGUN = 10**18
"""When the recordings were made (ns), long ago."""
OVER = ("judged", "failed", "cancelled")


def lines(count: int, every: int = 10**7, big: int = 7) -> Iterator[dict[str, Any]]:
    """Events of `single`, of which every so many is a violation."""
    for i in range(count):
        at = BEGUN + i * every
        yield {"stream": "/a", "stamp": at, "arrived": at + 1000, "data": {"v": 11 if i % big == big - 1 else 1}}


def log(path: Path, count: int = 100, **options: int) -> Path:
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines(count, **options)), encoding="utf-8")
    return path


def send(server: Server, path: Path, spec: str, *, status: int = 202, **query: Any) -> dict[str, Any]:
    asked = {"spec": spec, "name": path.name} | query
    answer = server.http.post("/api/v1/recordings", params=asked, content=path.read_bytes())
    assert answer.status_code == status, answer.text
    found: dict[str, Any] = answer.json()
    return found


async def judged(server: Server, path: Path, spec: str, *, state: str = "judged", **query: Any) -> dict[str, Any]:
    """A recording once it is over."""
    sent = send(server, path, spec, **query)
    found = await server.until(lambda: server.get(f"recordings/{sent['id']}"), lambda one: one["state"] in OVER)
    assert found["state"] == state, found
    return dict(found)


def children(server: Server, module: str) -> list[int]:
    """The processes of a server that run a module."""
    found = Path(f"/proc/{server.process.pid}/task/{server.process.pid}/children").read_text(encoding="ascii")
    return [int(one) for one in found.split() if module in Path(f"/proc/{one}/cmdline").read_text(encoding="utf-8")]


def replayed(spec: Path, path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The records of `replay`, and its summary."""
    ended = run("replay", spec, path, "--json")
    *records, last = map(json.loads, ended.stdout.splitlines())
    return records, last["summary"]


async def held_against_replay(server: Server, spec: Path, path: Path) -> None:
    """A server says of a recording what `replay` says of it."""
    records, summary = replayed(spec, path)
    one = await judged(server, path, spec.stem)
    told = server.records(one["session"])
    assert len(told) == len(records)
    for mine, theirs in zip(told, records, strict=True):
        assert {key: mine.get(key) for key in theirs} == theirs
    assert one["exit"] == summary["exit"]
    assert one["events"] == summary["events"]
    assert set(summary["notes"]) <= set(one["notes"])
    state = server.get(f"sessions/{one['session']}")
    assert (state["kind"], state["status"], state["trouble"]) == ("recording", "closed", None)
    assert state["closed_because"] == "the recording was judged to its end"
    assert state["recording"]["complete"]
    for prop in state["properties"]:
        name = prop["id"] + (" (arrival)" if prop["order"] == "arrival" and len(state["properties"]) > 1 else "")
        theirs = summary["properties"].get(name, summary["properties"][prop["id"]])
        assert {key: prop[key] for key in theirs} == theirs


async def stands_by_its_records(server: Server, session: str) -> None:
    """The state of a session that is over tells of the records that are kept of it, and of violations among them."""
    records, state = server.records(session), server.get(f"sessions/{session}")
    broken = [record for record in records if record["violation"]]
    (prop,) = state["properties"]
    assert broken
    assert (prop["violations"], prop["outcome"]) == (len(broken), records[-1]["outcome"])
    assert (prop["first_violation"], prop["first_violation_step"]) == (broken[0]["n"], broken[0]["step"])
    assert prop["first_violation_at"] == broken[0]["stamp"]
    assert state["counters"]["steps"] == len(records)
    episodes = server.records(session, "episodes")
    assert sum(episode["count"] for episode in episodes) == len(broken)
    (listed,) = [one for one in server.get("sessions", brief=True)["items"] if one["id"] == session]
    assert (listed["violations"], listed["steps"], listed["outcome"]) == (len(broken), len(records), prop["outcome"])


BAGS: dict[str, Callable[[Path], Path]] = {
    "bag": lambda folder: write_ros1(folder / "pump.bag", ROUNDS),
    "db3": lambda folder: next(write_ros2(folder / "pump", StoragePlugin.SQLITE3, ROUNDS).glob("*.db3")),
    "mcap": lambda folder: next(write_ros2(folder / "pump", StoragePlugin.MCAP, ROUNDS).glob("*.mcap")),
}


@pytest.mark.parametrize("form", BAGS)
async def test_a_bag_is_judged_as_replay_judges_it(form: str, server: Server, tmp_path: Path) -> None:
    server.http.put("/api/v1/specs/pump", content=SPEC).raise_for_status()
    spec = tmp_path / "pump.yaml"
    spec.write_text(SPEC, encoding="utf-8")
    await held_against_replay(server, spec, BAGS[form](tmp_path))


@pytest.mark.parametrize("name", ["single", "both", "revising", "deadline"])
async def test_a_log_is_judged_as_replay_judges_it(name: str, server: Server, tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    with path.open("w", encoding="utf-8") as file:
        for i, line in enumerate(lines(40, every=10**8)):
            late = i % 9 == 4
            stream = "/a" if i % 2 or late else "/b"
            line |= {"stream": stream, "stamp": line["stamp"] - late * 5 * 10**8, "data": {"v": i // 2 % 5}}
            file.write(f"{json.dumps(line)}\n")
    await held_against_replay(server, SPECS[0] / f"{name}.yaml", path)


async def test_the_trace_of_a_session_is_judged_as_replay_judges_it(
    server: Server, session: str, tmp_path: Path
) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data={"v": 11 if i == 5 else 1}) for i in range(1, 21)))
        await monitor.acked(20)
        await monitor.detach()
    path = tmp_path / "trace.jsonl"
    path.write_text(server.http.get(f"/api/v1/sessions/{session}/trace").text, encoding="utf-8")
    await held_against_replay(server, SPECS[0] / "single.yaml", path)


async def test_its_session_is_one_like_others_in_the_recordings_time(
    server: Server, session: str, tmp_path: Path
) -> None:
    one = await judged(server, log(tmp_path / "log.jsonl"), "single", session=session)
    assert one["session"] == session
    state = server.get(f"sessions/{session}")
    assert state["begun"] == BEGUN + 1000
    (first, *_) = server.records(session, "violations")
    assert (first["step"], first["stamp"]) == (7, BEGUN + 6 * 10**7)
    (episode,) = server.records(session, "episodes")
    assert (episode["began"], episode["count"], episode["open"]) == (first["stamp"], 14, False)
    timeline = server.get(f"sessions/{session}/timeline")
    assert sum(timeline["violations"]["a_is_small"]) == 14
    assert timeline["first"] == BEGUN
    explained = server.get(f"sessions/{session}/verdicts/{first['n']}/explanation")
    assert explained["explanation"] == first["explanation"]
    path = tmp_path / "trace.jsonl"
    path.write_text(server.http.get(f"/api/v1/sessions/{session}/trace").text, encoding="utf-8")
    again, _ = replayed(SPECS[0] / "single.yaml", path)
    assert [r["outcome"] for r in again] == [r["outcome"] for r in server.records(session)]


async def test_a_recordings_time_is_not_the_servers(start: Starts, tmp_path: Path) -> None:
    server, path = start(), tmp_path / "log.jsonl"
    path.write_text(json.dumps({"stream": "/a", "stamp": 2**62, "arrived": 2**62, "data": {"v": 1}}), encoding="utf-8")
    await judged(server, path, "single")
    assert server.stop() == 0
    server = start()
    async with attached(server, session="now", spec="single") as monitor:
        await monitor.send(make_event(1, at=1, data={"v": 1}))
        await monitor.acked(1)
        (record,) = server.records("now")
        assert record["judged"] < 2**61
        await monitor.detach()


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "log.jsonl: has no event at all"),
        (b"PK\x03\x04 no recording", "log.jsonl: is compressed by zip"),
        (
            b'{"stream": "/other", "stamp": 1, "data": {}}\n',
            "has no event of single, which observes /a; it has /other",
        ),
    ],
)
async def test_what_can_not_be_judged_is_told_as_text(
    content: bytes, told: str, server: Server, session: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.jsonl"
    path.write_bytes(content)
    one = await judged(server, path, "single", state="failed", session=session)
    assert told in one["error"], one
    assert str(server.data) not in json.dumps(one)
    assert one["session"] is None
    assert server.http.get(f"/api/v1/sessions/{session}").status_code == 404


@pytest.mark.parametrize("form", BAGS)
async def test_damaged_bags_end_in_an_answer(form: str, server: Server, tmp_path: Path) -> None:
    server.http.put("/api/v1/specs/pump", content=SPEC).raise_for_status()
    whole = BAGS[form](tmp_path).read_bytes()
    spec = tmp_path / "pump.yaml"
    spec.write_text(SPEC, encoding="utf-8")
    for i, data in enumerate((whole[:100], whole[: len(whole) // 2], whole[:200] + bytes(200) + whole[400:])):
        path = tmp_path / f"damaged-{i}.{form}"
        path.write_bytes(data)
        ended = run("replay", spec, path, "--json")
        sent = send(server, path, "pump")
        where = f"recordings/{sent['id']}"
        one = await server.until(partial(server.get, where), lambda one: one["state"] in OVER)
        assert (one["state"] == "judged") == (ended.returncode != 2), (one, ended)
        if one["state"] == "judged":
            assert one["exit"] == ended.returncode
        assert str(server.data) not in json.dumps(one)


async def test_what_grows_when_it_is_unpacked_has_an_end(start: Starts, tmp_path: Path) -> None:
    server, path = start(ORACLE_HISTORY="memory", ORACLE_MAX_RECORDING="1MB"), tmp_path / "bomb.mcap.zstd"
    path.write_bytes(zstandard.compress(MCAP + bytes(10**8)))
    assert path.stat().st_size < 10**5
    one = await judged(server, path, "single", state="failed")
    assert one["error"].startswith("bomb.mcap.zstd: can't be unpacked to the folder for temporary files")
    assert one["error"].endswith("File too large")
    assert list((server.data / "recordings").iterdir()) == []


async def test_what_was_judged_before_the_damage_is_kept(server: Server, session: str, tmp_path: Path) -> None:
    path = log(tmp_path / "log.jsonl", 30)
    with path.open("a", encoding="utf-8") as file:
        file.write('{"stream": garbage\n')
    one = await judged(server, path, "single", state="failed", session=session)
    assert one["error"].startswith("log.jsonl:31")
    assert len(server.records(session)) == 30
    await stands_by_its_records(server, session)


async def test_others_are_decided_on_while_a_recording_is_judged(
    server: Server, bystander: None, tmp_path: Path
) -> None:
    assert (await judged(server, log(tmp_path / "log.jsonl", 3000), "single"))["events"] == 3000


async def test_a_recording_is_cancelled_and_its_session_says_so(server: Server, session: str, tmp_path: Path) -> None:
    path = log(tmp_path / "log.jsonl", 20_000)
    sent = send(server, path, "single", session=session)
    where = f"recordings/{sent['id']}"
    await server.until(lambda: server.get(where), lambda one: one["session"] is not None)
    await server.until(lambda: server.get(f"sessions/{session}/violations")["items"], len)
    assert problem(server.http.post("/api/v1/recordings", params={"spec": "single"}, content=b"{}"), 429)
    assert server.get(f"sessions/{session}")["status"] == "open"
    gone = server.http.delete(f"/api/v1/{where}").json()
    assert (gone["state"], gone["error"]) == ("cancelled", "it was cancelled")
    state = server.get(f"sessions/{session}")
    assert (state["status"], state["trouble"]) == ("closed", "incomplete: it was cancelled")
    assert len(server.records(session)) < 20_000
    await stands_by_its_records(server, session)
    assert (await judged(server, log(tmp_path / "next.jsonl"), "single"))["events"] == 100


async def test_closing_its_session_cancels_it(server: Server, session: str, tmp_path: Path) -> None:
    sent = send(server, log(tmp_path / "log.jsonl", 20_000), "single", session=session)
    await server.until(lambda: server.get(f"recordings/{sent['id']}"), lambda one: one["session"] is not None)
    state = server.http.delete(f"/api/v1/sessions/{session}").json()
    assert (state["status"], state["recording"]["complete"]) == ("closed", False)
    assert server.get(f"recordings/{sent['id']}")["state"] == "cancelled"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
async def test_what_a_server_did_not_judge_to_its_end_is_never_complete(
    number: signal.Signals, start: Starts, tmp_path: Path
) -> None:
    server = start()
    sent = send(server, log(tmp_path / "log.jsonl", 60_000), "single", session="cut")
    await server.until(lambda: server.get(f"recordings/{sent['id']}"), lambda one: one["events"])
    await server.until(lambda: server.get("sessions/cut/violations", limit=1)["items"], len)
    server.stop(number)
    server = start()
    state = server.get("sessions/cut")
    assert state["status"] == "closed"
    assert state["trouble"].startswith("incomplete: the server ")
    assert 0 < len(server.records("cut")) < 60_000
    await stands_by_its_records(server, "cut")
    assert not (server.data / "recordings").exists()
    assert server.get("recordings")["items"] == []
    assert (await judged(server, log(tmp_path / "next.jsonl"), "single"))["exit"] == 1


async def test_a_process_that_is_killed_leaves_no_complete_session(
    server: Server, session: str, tmp_path: Path
) -> None:
    sent = send(server, log(tmp_path / "log.jsonl", 20_000), "single", session=session)
    where = f"recordings/{sent['id']}"
    await server.until(lambda: server.get(where), lambda one: one["session"] is not None)
    await server.until(lambda: server.get(f"sessions/{session}/violations")["items"], len)
    for process in children(server, "oracle_server.jobs.judging"):
        os.kill(process, signal.SIGKILL)
    one = await server.until(lambda: server.get(where), lambda one: one["state"] in OVER)
    assert (one["state"], one["error"]) == ("failed", "the process that judges it has ended before its time")
    assert server.get(f"sessions/{session}")["trouble"] == f"incomplete: {one['error']}"
    await stands_by_its_records(server, session)


async def test_a_monitor_can_not_attach_to_it(server: Server, session: str, tmp_path: Path) -> None:
    sent = send(server, log(tmp_path / "log.jsonl", 20_000), "single", session=session)
    await server.until(lambda: server.get(f"recordings/{sent['id']}"), lambda one: one["session"] is not None)
    with pytest.raises(AssertionError, match="judges a recording"):
        async with attached(server, session=session, spec="single"):
            pass
    server.http.delete(f"/api/v1/recordings/{sent['id']}")


async def test_it_has_a_size(start: Starts, tmp_path: Path) -> None:
    server = start(ORACLE_HISTORY="memory", ORACLE_MAX_RECORDING="2MB")
    path = log(tmp_path / "log.jsonl", 30_000)
    assert path.stat().st_size > 2 * 10**6
    assert "ORACLE_MAX_RECORDING" in send(server, path, "single", status=413)["detail"]
    pieces = (path.read_bytes()[i : i + 2**16] for i in range(0, path.stat().st_size, 2**16))  # of no announced size
    assert problem(server.http.post("/api/v1/recordings", params={"spec": "single"}, content=pieces), 413)
    assert list((server.data / "recordings").iterdir()) == []
    assert server.get("recordings")["items"] == []


async def test_names_and_specs_that_can_not_be_are_refused(server: Server, session: str, tmp_path: Path) -> None:
    path = log(tmp_path / "log.jsonl", 3)
    assert "there is no spec 'nowhere'" in send(server, path, "nowhere", status=404)["detail"]
    await judged(server, path, "single", session=session)
    assert "exists already" in send(server, path, "single", status=409, session=session)["detail"]
    one = await judged(server, path, "single", name="../../../../etc/passwd\n<b>")
    assert server.get(f"sessions/{one['session']}")["recording"]["name"] == "../../../../etc/passwd\n<b>"
    assert not any(p.name != "recordings" for p in server.data.glob("*passwd*"))


async def test_a_token_sends_what_it_is_bound_to(start: Starts, tmp_path: Path) -> None:
    server = start(ORACLE_HISTORY="memory")
    file = server.data / "tokens.json"
    tokens = {
        "read": add(file, "read", ["read"]),
        "spec": add(file, "spec", ["submit", "read"], specs=["single"]),
        "session": add(file, "session", ["submit", "read"], sessions=["ours"]),
        "admin": add(file, "admin", ["admin"]),
    }
    path = log(tmp_path / "log.jsonl", 20)

    def by(name: str, method: str, where: str, **query: str) -> httpx.Response:
        headers = {"Authorization": f"Bearer {tokens[name]}"}
        content = path.read_bytes() if method == "POST" else None
        return server.http.request(method, f"/api/v1/{where}", params=query, headers=headers, content=content)

    assert by("read", "POST", "recordings", spec="single").status_code == 403
    assert by("spec", "POST", "recordings", spec="pair").status_code == 403
    assert by("session", "POST", "recordings", spec="single").status_code == 403
    assert by("session", "POST", "recordings", spec="single", session="theirs").status_code == 403
    sent = by("session", "POST", "recordings", spec="single", session="ours").json()
    where = f"recordings/{sent['id']}"
    await server.until(lambda: by("session", "GET", where).json(), lambda one: one["state"] in OVER)
    other = by("admin", "POST", "recordings", spec="pair", session="foreign").json()
    assert by("session", "GET", f"recordings/{other['id']}").status_code == 404
    assert by("spec", "DELETE", f"recordings/{other['id']}").status_code == 404
    assert [one["id"] for one in by("session", "GET", "recordings").json()["items"]] == [sent["id"]]
    assert by("spec", "DELETE", where).status_code == 403, "it is another client's"
    assert by("admin", "DELETE", where).status_code == 200


async def test_a_message_on_every_of_many_topics_is_no_harm(server: Server, bystander: None, tmp_path: Path) -> None:
    path = tmp_path / "topics.jsonl"
    with path.open("w", encoding="utf-8") as file:
        file.writelines(json.dumps({"stream": f"/t{i}", "stamp": BEGUN + i, "data": {}}) + "\n" for i in range(100_000))
        file.write(json.dumps({"stream": "/a", "stamp": BEGUN + 200_000, "data": {"v": 1}}) + "\n")
    one = await judged(server, path, "single")
    assert one["events"] == 1


async def test_live_decisions_do_not_depend_on_it(server: Server, session: str, tmp_path: Path) -> None:
    """Events asked about before, during and after get the same decisions."""
    sent = send(server, log(tmp_path / "log.jsonl", 5000), "single")
    async with attached(server, "lamp1", session=session, spec="lamp", streams=["/light", "/switch"]) as monitor:
        await monitor.send(make_clock("/switch", 10**9, "response"))
        for i in range(10):
            level = 3 if i % 2 else 300
            await monitor.send(
                make_event(2 * i + 1, "/light", 2 * i, {"level": level}), make_clock("/light", 2 * i + 2)
            )
            request = {"stream": "/switch", "kind": "request", "data": {"switch_on": True}, "call": i}
            decision = await monitor.ask(2 * i + 2, at=2 * i + 1, **request)
            assert decision["decision"] == ("allow" if level == 3 else "deny")
        await monitor.detach()
    await server.until(lambda: server.get(f"recordings/{sent['id']}"), lambda one: one["state"] == "judged")
