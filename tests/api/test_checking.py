"""Texts of specs that are checked over HTTP, and texts that are stored in place of others."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

import pytest

from oracle_server.jobs import checking
from oracle_server.jobs.checking import Checking
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import load_spec
from oracle_server.specfiles.lowered import lowered
from tests.api.conftest import Asked
from tests.api.test_specs import SPEC

WARNED = SPEC.replace("{v > 1}", "exists[x]. {v: *x} -> {v > 1}")
NEW = "/api/v1/specs/new"


async def test_a_check_says_what_check_says_and_stores_nothing(asked: Asked, tmp_path: Path) -> None:
    path = tmp_path / "new.yaml"
    path.write_text(WARNED, encoding="utf-8")
    loaded = load_spec(path, types=Types())
    answer = (await asked.http.post(f"{NEW}/check", content=WARNED)).json()
    assert answer["findings"] == [
        {"line": f.line, "column": f.column, "message": f.message, "severity": f.severity, "kind": f.kind}
        for f in loaded.warnings
    ]
    assert [f["severity"] for f in answer["findings"]] == ["warning"]
    assert answer["formulas"] == list(lowered(loaded.spec.properties))
    assert (answer["sound"], answer["digest"]) == (True, loaded.spec.digest)
    assert (await asked.http.get(NEW)).status_code == 404


async def test_what_is_wrong_is_told_with_its_place(asked: Asked) -> None:
    answer = (await asked.http.post(f"{NEW}/check", content=SPEC.replace("{v > 1}", "{v >}"))).json()
    assert not answer["sound"]
    assert (answer["digest"], answer["formulas"]) == ("", [])
    (found,) = answer["findings"]
    assert (found["line"], found["severity"]) == (3, "error")
    other = (await asked.http.post("/api/v1/specs/other/check", content=SPEC)).json()
    assert not other["sound"]
    assert other["findings"][0]["message"] == "its id is 'new', not 'other'"


async def test_a_checker_that_was_killed_is_started_anew() -> None:
    checks = Checking()
    try:
        assert (await checks.check("new", SPEC)).digest
        process = checks._worker.process
        assert process is not None
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        assert (await checks.check("new", SPEC)).digest
    finally:
        checks.close()


async def test_a_check_has_an_end(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    assert (await asked.http.post(f"{NEW}/check", content=SPEC)).json()["sound"]
    process = asked.checking._worker.process
    assert process is not None
    process.send_signal(signal.SIGSTOP)
    monkeypatch.setattr(checking, "WITHIN", 0.0)
    answer = await asked.http.post(f"{NEW}/check", content=SPEC)
    assert answer.status_code == 422
    assert answer.json()["detail"] == "the spec can't be checked: no answer within 0 s"
    monkeypatch.undo()
    assert (await asked.http.post(f"{NEW}/check", content=SPEC)).json()["sound"]


async def test_not_more_checks_wait_than_may(asked: Asked) -> None:
    answers = await asyncio.gather(
        *(asked.http.post(f"{NEW}/check", content=SPEC) for _ in range(checking.WAITING + 5))
    )
    statuses = [answer.status_code for answer in answers]
    assert set(statuses) == {200, 429}
    assert statuses.count(200) >= checking.WAITING
    assert (await asked.http.post(f"{NEW}/check", content=SPEC)).status_code == 200


async def test_a_text_is_stored_only_in_place_of_what_its_sender_knows(asked: Asked) -> None:
    once = {"If-None-Match": "*"}
    assert (await asked.http.put(NEW, content=SPEC, headers={"If-Match": "*"})).status_code == 412
    assert (await asked.http.put(NEW, content=SPEC, headers=once)).status_code == 201
    assert (await asked.http.put(NEW, content=SPEC, headers=once)).status_code == 412
    tag = (await asked.http.get(NEW)).headers["etag"]
    commented = f"# of another meaning to people alone\n{SPEC}"
    changed = await asked.http.put(NEW, content=commented, headers={"If-Match": tag})
    assert changed.status_code == 200
    late = await asked.http.put(NEW, content=SPEC, headers={"If-Match": tag})
    assert late.status_code == 412
    assert late.json()["detail"] == "spec 'new' was changed meanwhile: get it again, and compare"
    assert (await asked.http.get(NEW)).json()["text"] == commented
    now = changed.headers["etag"]
    assert now == (await asked.http.get(NEW)).headers["etag"] != tag
    assert (await asked.http.put(NEW, content=SPEC, headers={"If-Match": f'"x", {now}'})).status_code == 200
    assert (await asked.http.put(NEW, content=commented, headers={"If-Match": "*"})).status_code == 200
    assert (await asked.http.put(NEW, content=SPEC, headers={"If-None-Match": tag})).status_code == 422


async def test_of_two_who_know_the_same_text_one_is_told_to_compare(asked: Asked) -> None:
    await asked.http.put(NEW, content=SPEC)
    tag = (await asked.http.get(NEW)).headers["etag"]
    texts = [f"# {i}\n{SPEC}" for i in range(8)]
    answers = await asyncio.gather(*(asked.http.put(NEW, content=t, headers={"If-Match": tag}) for t in texts))
    assert sorted(answer.status_code for answer in answers) == [200] + 7 * [412]


async def test_a_file_that_was_edited_is_not_what_its_reader_knows(asked: Asked, tmp_path: Path) -> None:
    path = tmp_path / "specs" / "lamp.yaml"
    tag = (await asked.http.get("/api/v1/specs/lamp")).headers["etag"]
    text = path.read_text(encoding="utf-8")
    path.write_text(f"# edited\n{text}", encoding="utf-8")
    answer = await asked.http.put("/api/v1/specs/lamp", content=text, headers={"If-Match": tag})
    assert answer.status_code == 412
