"""Questions to the history: every filter, every page."""

from __future__ import annotations

from typing import Any

import pytest

from tests.whole.client import attached, make_event, make_events
from tests.whole.harness import Server, problem
from tests.whole.stories import tell


async def told(server: Server, session: str) -> list[dict[str, Any]]:
    """A session with records of all sorts."""
    (chunk,) = tell(5, chunks=1, length=45)
    async with attached(server, session=session, spec="pair", streams=["/a", "/b", "/go", "/free"]) as monitor:
        await monitor.send(make_events(*chunk.events), *chunk.clocks)
        await monitor.acked(chunk.last)
    records = server.records(session)
    assert [r["n"] for r in records] == list(range(1, len(records) + 1))
    assert {r["outcome"] for r in records} == {"currently_true", "currently_false", "false", "unknown"}
    return records


@pytest.mark.parametrize("closed", [False, True])
async def test_what_a_session_does_not_have_is_told_and_not_found_to_be_fine(
    server: Server, session: str, closed: bool
) -> None:
    """Nothing that is found of it would be no good news."""
    await told(server, session)
    if closed:
        assert server.http.delete(f"/api/v1/sessions/{session}").is_success
    for what in ("verdicts", "violations", "episodes", "stream", "episodes/stream"):
        path = f"/api/v1/sessions/{session}/{what}"
        found = problem(server.http.get(path, params={"property": ["a_is_small", "never_zro"]}), 422)
        assert found["detail"] == "query.property: pair has no property `never_zro`; did you mean `never_zero`?"
        if "episodes" not in what:
            found = problem(server.http.get(path, params={"stream": "/nowhere"}), 422)
            assert found["detail"].startswith("query.stream: pair has no stream `/nowhere`; there are /a or ")


async def test_filters_choose_records(server: Server, session: str) -> None:
    records = await told(server, session)
    stamps = sorted(r["stamp"] for r in records)
    since, until = stamps[len(stamps) // 4], stamps[len(stamps) // 2]
    choices: list[tuple[dict[str, Any], Any]] = [
        ({"property": "a_is_small"}, lambda r: r["property"] == "a_is_small"),
        ({"property": ["a_is_small", "b_after_a"]}, lambda r: r["property"] in ("a_is_small", "b_after_a")),
        ({"outcome": "unknown"}, lambda r: r["outcome"] == "unknown"),
        ({"outcome": ["false", "currently_false"]}, lambda r: r["outcome"] in ("false", "currently_false")),
        ({"outcome": "true"}, lambda r: False),
        ({"stream": "/go"}, lambda r: r["stream"] == "/go"),
        ({"since": since}, lambda r: r["stamp"] >= since),
        ({"until": until}, lambda r: r["stamp"] <= until),
        ({"since": since, "until": until}, lambda r: since <= r["stamp"] <= until),
        ({"after": 17}, lambda r: r["n"] > 17),
        ({"after": len(records)}, lambda r: False),
        (
            {"property": "a_is_small", "outcome": "currently_false", "stream": "/a", "since": since, "after": 17},
            lambda r: (
                (r["property"], r["outcome"], r["stream"]) == ("a_is_small", "currently_false", "/a")
                and r["stamp"] >= since
                and r["n"] > 17
            ),
        ),
    ]
    for query, wanted in choices:
        page = server.get(f"sessions/{session}/verdicts", limit=1000, **query)
        assert page["items"] == [r for r in records if wanted(r)], query
        assert page["next"] is None
        if "after" not in query:
            found = server.records(session, order="desc", limit=13, **query)
            assert found == [r for r in reversed(records) if wanted(r)], query


@pytest.mark.parametrize("limit", [1, 7, 1000])
@pytest.mark.parametrize("order", ["asc", "desc"])
async def test_pages_put_together_are_the_whole(server: Server, session: str, limit: int, order: str) -> None:
    records = await told(server, session)
    assert len(records) > 200
    pages, after = [], None
    while True:
        query = {"limit": limit, "order": order} | ({} if after is None else {"after": after})
        page = server.get(f"sessions/{session}/verdicts", **query)
        pages.append(page["items"])
        if page["next"] is None:
            break
        assert len(page["items"]) == limit
        after = page["next"]
    whole = [r for page in pages for r in page]
    assert whole == (records if order == "asc" else records[::-1])
    assert len(pages) == -(-len(records) // limit)


async def test_a_cursor_stays_where_it_is_while_records_come(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_events(*(make_event(i, at=i, data={"v": 1}) for i in range(1, 11))))
        await monitor.acked(10)
        up = server.get(f"sessions/{session}/verdicts", limit=4)
        down = server.get(f"sessions/{session}/verdicts", limit=4, order="desc")
        assert [r["n"] for r in up["items"]] == [1, 2, 3, 4]
        assert [r["n"] for r in down["items"]] == [10, 9, 8, 7]
        await monitor.send(make_events(*(make_event(i, at=i, data={"v": 1}) for i in range(11, 21))))
        await monitor.acked(20)
    following = server.get(f"sessions/{session}/verdicts", limit=100, after=up["next"])
    assert [r["n"] for r in following["items"]] == list(range(5, 21))
    before = server.get(f"sessions/{session}/verdicts", limit=100, after=down["next"], order="desc")
    assert [r["n"] for r in before["items"]] == list(range(6, 0, -1))
    assert server.get(f"sessions/{session}/verdicts", after=20) == {"items": [], "next": None, "kept_from": 1}


async def test_violations_are_those_verdicts_with_their_explanations(server: Server, session: str) -> None:
    records = await told(server, session)
    violations = server.records(session, "violations")
    assert violations == [r for r in records if r["violation"]]
    assert {r["property"] for r in violations} >= {"a_is_small", "b_after_a", "never_zero", "stays_small"}
    for r in violations:
        assert r["outcome"] in ("currently_false", "false")
        why = r["explanation"]
        assert why["event"]["seq"] == r["seq"]
        assert why["event"]["stream"] == r["stream"]
        assert why["formula"]
        assert why["text"]
    assert all(r["explanation"] is None for r in records if not r["violation"])
    some = server.records(
        session, "violations", property=["a_is_small", "never_zero"], stream="/a", order="desc", limit=2
    )
    wanted = ("a_is_small", "never_zero")
    assert some == [r for r in reversed(violations) if r["property"] in wanted and r["stream"] == "/a"]


@pytest.mark.parametrize(
    "query",
    [
        "limit=0",
        "limit=1001",
        "limit=-1",
        "limit=ten",
        "after=-1",
        "after=x",
        "after=9223372036854775808",
        "since=-1",
        "until=now",
        "until=9223372036854775808",
        "order=up",
        "outcome=maybe",
        "outcome=true&outcome=maybe",
    ],
)
async def test_a_question_that_can_not_be_read_is_refused(server: Server, session: str, query: str) -> None:
    server.http.post("/api/v1/sessions", json={"spec": "single", "id": session})
    body = problem(server.http.get(f"/api/v1/sessions/{session}/verdicts?{query}"), 422)
    assert query.split("=", maxsplit=1)[0] in body["errors"][0]["where"]


@pytest.mark.parametrize("order", ["asc", "desc"])
async def test_the_largest_and_smallest_questions_are_answered(server: Server, session: str, order: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        await monitor.acked(1)
    for name in ("after", "since", "until"):
        for value in (0, 1, 2**63 - 1):
            query: dict[str, str | int] = {name: value, "order": order}
            assert server.http.get(f"/api/v1/sessions/{session}/verdicts", params=query).status_code == 200, query
