"""Who comes back for verdicts that are not kept any more is told so, and so is who read those of another history."""

from __future__ import annotations

import json
from typing import Any

import httpx
import pytest

from oracle_server.api import stream
from oracle_server.cli.client import Client
from oracle_server.history import pages
from oracle_server.history.records import SessionRecord
from tests.api.conftest import Asked
from tests.sessions.making import GUARD, Kept, attach, event

COUNT, KEPT_FROM = 20, 11


@pytest.fixture
async def filled(asked: Asked) -> Asked:
    """A session of which the first verdicts are deleted; it is closed, so that its stream ends."""
    asked.registry._library.put("guard", GUARD)
    live, monitor = await asked.registry.attach(attach("s", "guard"), Kept())
    for seq in range(1, COUNT + 1):
        live.ingest(monitor, event(seq, speed=9 if seq % 2 else 1))
        live.ledger.write()
    await asked.registry._history.flush()
    await asked.registry._history.forget_steps(live.number, KEPT_FROM)
    assert (await asked.http.delete("/api/v1/sessions/s")).status_code == 200
    return asked


def parsed(text: str) -> list[dict[str, Any]]:
    """The events of a stream: their ids, or their names and data."""
    found = []
    for block in text.split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.splitlines() if ": " in line and line[0] != ":")
        if fields:
            found.append({"id": int(fields["id"])} if "id" in fields else {fields["event"]: json.loads(fields["data"])})
    return found


ALL_KEPT = [{"id": n} for n in range(KEPT_FROM, COUNT + 1)]
DELETED = "verdicts 4 to 10 are not kept any more"
OTHER = "there is no verdict 50: another session of this name is told from its begin on"


@pytest.mark.parametrize(
    ("last", "told"),
    [
        (0, ALL_KEPT),
        (3, [{"missed": {"after": 3, "next": KEPT_FROM, "why": DELETED}}, *ALL_KEPT]),
        (KEPT_FROM - 1, ALL_KEPT),
        (15, ALL_KEPT[5:]),
        (COUNT, []),
        (50, [{"missed": {"after": 50, "next": KEPT_FROM, "why": OTHER}}, *ALL_KEPT]),
    ],
)
async def test_a_stream_goes_on_with_what_there_is_and_says_what_it_lacks(
    filled: Asked, last: int, told: list[dict[str, Any]]
) -> None:
    path = "/api/v1/sessions/s/stream"
    by_header = await filled.http.get(path, headers={"Last-Event-ID": str(last)})
    by_query = await filled.http.get(path, params={"after": last})
    assert parsed(by_header.text) == parsed(by_query.text) == [*told, {"closed": {}}]


async def test_of_what_is_asked_for_alone_it_says_what_it_lacks(filled: Asked) -> None:
    answer = await filled.http.get("/api/v1/sessions/s/stream", params={"after": 3, "violations": True})
    told = parsed(answer.text)
    assert told[0]["missed"]["next"] == KEPT_FROM
    assert [each["id"] for each in told[1:-1]] == [n for n in range(KEPT_FROM, COUNT + 1) if n % 2]


async def test_what_retention_deletes_while_a_page_is_read_is_told_too(
    filled: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was looked for before the page was read alone: where it went in between, the stream went on behind it."""
    (kept,) = filled.registry._history._kept.values()  # type: ignore[attr-defined]
    real = pages.find

    async def find(*question: Any) -> Any:
        await filled.registry._history.forget_steps(kept.record.number, 16)
        return await real(*question)

    monkeypatch.setattr(stream, "find", find)
    answer = await filled.http.get("/api/v1/sessions/s/stream", params={"after": 12})
    missed = {"missed": {"after": 12, "next": 16, "why": "verdicts 13 to 15 are not kept any more"}}
    assert parsed(answer.text) == [missed, *({"id": n} for n in range(16, COUNT + 1)), {"closed": {}}]


@pytest.mark.parametrize("begin", [0, 3, 11, 13, 14, 16, 17])
@pytest.mark.parametrize("violations", [False, True])
async def test_what_a_robot_deleted_before_it_forwarded_is_told_at_its_place(
    filled: Asked, monkeypatch: pytest.MonkeyPatch, begin: int, violations: bool
) -> None:
    history: Any = filled.registry._history
    gaps = [(1, 10), (14, 16)]

    async def missing(_: SessionRecord) -> list[tuple[int, int]]:
        return gaps

    monkeypatch.setattr(history, "missing", missing)
    monkeypatch.setattr(stream, "_PAGE", 2)
    (kept,) = history._kept.values()
    kept.steps = [step for step in kept.steps if step.position not in range(14, 17)]
    answer = await filled.http.get("/api/v1/sessions/s/stream", params={"after": begin, "violations": violations})
    why = "verdicts 14 to 16 were deleted at the robot before they were forwarded"
    gap = [{"missed": {"after": 13, "next": 17, "why": why}}]
    before, behind = ([{"id": n} for n in some if n % 2 or not violations] for some in (range(11, 14), range(17, 21)))
    told = [each for each in before if each["id"] > begin] + gap * (begin < 16)
    told += [each for each in behind if each["id"] > begin]
    deleted = [{"missed": {"after": 3, "next": KEPT_FROM, "why": DELETED}}] * (begin == 3)
    assert parsed(answer.text) == [*deleted, *told, {"closed": {}}]


@pytest.mark.parametrize(
    "what", ["verdicts/{}/explanation", "verdicts/{}/parts", "sequence?n={}", "sequence?before={}"]
)
async def test_a_verdict_that_is_not_kept_any_more_is_not_one_that_comes_yet(what: str, filled: Asked) -> None:
    numbers = KEPT_FROM - 1, COUNT, COUNT + 1
    gone, kept, early = [await filled.http.get(f"/api/v1/sessions/s/{what.format(n)}") for n in numbers]
    assert (gone.status_code, gone.json()["detail"]) == (410, "verdict 10 of session 's' is not kept any more")
    assert kept.status_code != 410
    assert (early.status_code, early.json()["detail"]) == (404, "session 's' has no verdict 21 in its history yet")


def test_the_command_line_says_it_too_and_goes_on_behind_it() -> None:
    missed = json.dumps({"after": 50, "next": 1, "why": "another one"})
    answers = iter([f"event: missed\ndata: {missed}\n\n", 'id: 1\ndata: {"n": 1}\n\nevent: closed\ndata: {}\n\n'])
    asked, notes = list[str](), list[str]()

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(request.headers["Last-Event-ID"])
        return httpx.Response(200, text=next(answers), headers={"content-type": "text/event-stream"})

    client = Client("http://127.0.0.1:1")
    client._http = httpx.Client(base_url="http://127.0.0.1:1/api/v1/", transport=httpx.MockTransport(answer))
    assert list(client.events("sessions/s/stream", notes.append)) == [{"n": 1}]
    assert (asked, notes) == (["0", "0"], ["another one"])
