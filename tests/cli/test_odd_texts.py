"""The command line and texts that some take for the end of a line, or can't print."""

from __future__ import annotations

import asyncio
import json
import os
from pathlib import Path

import pytest

from oracle_server.replay.report.table import csv_cell
from tests.whole.client import attached, make_event
from tests.whole.harness import Server, failed, run

BREAKS = "a\u2028b\u2029c\x85d\x0be\x0cf\x1cg\r\nü"
"""What `str.splitlines` splits, and JSON holds as it is or escaped."""


async def test_a_text_with_line_breaks_of_other_kinds_is_recorded_and_followed(server: Server, tmp_path: Path) -> None:
    session = "breaks"
    async with attached(server, session=session, spec="texts") as monitor:
        await monitor.send(*(make_event(n, at=n, data={"name": BREAKS, "list": []}) for n in range(1, 4)))
        await monitor.acked(3)
        await monitor.detach()
    assert server.http.delete(f"/api/v1/sessions/{session}").is_success
    records = server.records(session)
    assert records[2]["explanation"]["event"]["signals"]["name"] == BREAKS

    told = await asyncio.to_thread(run, "verdicts", session, "--follow", "--json", "--url", server.url)
    assert (told.returncode, told.stderr) == (0, "")
    assert [json.loads(line) for line in told.stdout.split("\n")[:-1]] == records
    for name in ("trace.jsonl", "trace.mcap"):
        out = tmp_path / name
        told = await asyncio.to_thread(run, "record", session, "-o", out, "--url", server.url)
        assert (told.returncode, told.stdout) == (0, f"{out}: 3 lines of {session}\n")
        told = await asyncio.to_thread(run, "replay", "--json", server.specs / "texts.yaml", out)
        *again, _ = map(json.loads, told.stdout.split("\n")[:-1])
        assert [r["outcome"] for r in again] == [r["outcome"] for r in records]
    lines = (tmp_path / "trace.jsonl").read_bytes().split(b"\n")[:-1]
    assert [json.loads(line)["signals"]["name"] for line in lines] == [BREAKS] * 3

    for shown in (
        run("verdicts", session, "--url", server.url),
        run("verdicts", session, "--explain", "3", "--url", server.url),
        run("replay", server.specs / "texts.yaml", tmp_path / "trace.jsonl"),
    ):
        assert r"a\u2028b\u2029c\x85d\x0be\x0cf\x1cg\r\nü" in shown.stdout
        assert shown.stdout.splitlines() == shown.stdout.split("\n")[:-1]


PLAIN = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": ""}
"""A machine whose locale has ASCII only, and a Python that believes it."""
ODD = """\
id: odd
description: Tür
streams:
  - topic: /a
properties:
  - id: closed
    description: über
    formula: 'not {door: "Tür"}'
"""


@pytest.mark.parametrize(
    ("session", "locale"), [("c", PLAIN), ("latin", {"PYTHONIOENCODING": "latin-1"}), ("default", {})]
)
async def test_what_is_printed_is_utf_8_whatever_the_locale(
    server: Server, tmp_path: Path, session: str, locale: dict[str, str]
) -> None:
    spec, trace = tmp_path / "spec.yaml", tmp_path / "trace.jsonl"
    spec.write_text(ODD + "    guards: [/Tür]\n", encoding="utf-8")
    assert "/Tür" in run("check", spec, **locale).stderr
    spec.write_text(ODD, encoding="utf-8")
    assert f"{spec}: sound\n" in run("check", spec, **locale).stdout
    trace.write_text('{"stream": "/a", "arrived": 1, "data": {"door": "Tür"}}\n', encoding="utf-8")
    for form in ("text", "jsonl", "csv", "junit"):
        ended = run("replay", "--format", form, spec, trace, **locale)
        assert (ended.returncode, ended.stderr) == (1, "")
        assert "Tür" in ended.stdout

    config, out = tmp_path / "config.yaml", tmp_path / "imported.yaml"
    config.write_text("monitors: [{monitor: {id: m, topics: [{name: a, type: x.msg.Tür}]}}]", encoding="utf-8")
    assert "Tür" in run("import", config, **locale).stdout
    run("import", config, "-o", out, **locale)
    assert "Tür" in out.read_text(encoding="utf-8")

    assert server.http.put("/api/v1/specs/odd", content=ODD.encode()).is_success
    async with attached(server, session=session, spec="odd") as monitor:
        await monitor.send(make_event(1, data={"door": "Tür"}))
        await monitor.acked(1)
    server.http.delete(f"/api/v1/sessions/{session}")
    assert "Tür" in (await asyncio.to_thread(run, "specs", "--url", server.url, **locale)).stdout
    for options in ([], ["--explain", "1"]):
        told = await asyncio.to_thread(run, "verdicts", session, "--url", server.url, *options, **locale)
        assert (told.returncode, told.stderr) == (0, "")
        assert "Tür" in told.stdout


def test_arguments_that_no_server_can_be_asked_with(server: Server, tmp_path: Path) -> None:
    odd = os.fsdecode(b"\xff")
    for command in (["verdicts", odd], ["verdicts", odd, "--follow"], ["record", odd, "-o", tmp_path / "out.jsonl"]):
        assert "'\\udcff' names no session" in failed(*command, "--url", server.url)
    assert "not a token" in failed("sessions", "--token", "ü", "--url", server.url)
    assert "can't be reached" in failed("sessions", "--url", f"{server.url}/{odd}")


HOSTILE = "a\x1b[2Jb\x07c\r\nviolation 99: forged"
COMMANDING = f"""\
id: commanding
description: {json.dumps(HOSTILE)}
streams:
  - topic: {json.dumps("/a" + HOSTILE)}
properties:
  - id: closed
    description: {json.dumps(HOSTILE)}
    formula: 'not {{door: *}}'
"""


async def test_no_text_commands_the_terminal_or_begins_a_line(server: Server, tmp_path: Path) -> None:
    put = server.http.put("/api/v1/specs/commanding", content=COMMANDING.encode())
    stream = "/a" + HOSTILE if put.is_success else "/a"
    if not put.is_success:
        harmless = COMMANDING.replace(json.dumps("/a" + HOSTILE), "/a")
        assert server.http.put("/api/v1/specs/commanding", content=harmless.encode()).is_success
    async with attached(server, session="commanding", spec="commanding") as monitor:
        await monitor.send(make_event(1, stream, data={"door": HOSTILE}))
        await monitor.acked(1)
    assert server.http.delete("/api/v1/sessions/commanding").is_success
    url, trace, spec = ("--url", server.url), tmp_path / "trace.jsonl", tmp_path / "commanding.yaml"
    spec.write_text(server.get("specs/commanding")["text"])
    recorded = await asyncio.to_thread(run, "record", "commanding", "-o", trace, *url)
    commands: list[tuple[str | Path, ...]] = [
        ("specs", *url),
        ("sessions", *url),
        ("verdicts", "commanding", *url),
        ("verdicts", "commanding", "--follow", *url),
        ("verdicts", "commanding", "--explain", "1", *url),
        ("verdicts", HOSTILE, *url),
        ("replay", spec, trace),
        ("replay", spec, trace, "--format", "csv"),
        ("check", spec),
    ]
    shown = [recorded, *[await asyncio.to_thread(run, *command) for command in commands]]
    text = "".join(ended.stdout + ended.stderr for ended in shown)
    assert "forged" in text
    assert all(char.isprintable() for char in text.replace("\r\n", "").replace("\n", ""))
    assert not any(line.startswith("violation 99") for line in text.splitlines())


def test_a_spreadsheet_runs_no_cell() -> None:
    for text in ("=HYPERLINK(1)", "+1", "-1", "@SUM(1)"):
        assert csv_cell(text) == f"'{text}"
    assert csv_cell("a\r\n=1") == r"a\r\n=1"
    assert [csv_cell(value) for value in (-1, -0.5, True, None, "a=1")] == [-1, -0.5, "true", None, "a=1"]
