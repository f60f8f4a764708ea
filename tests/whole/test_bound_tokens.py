"""What a bound token may not know is in no answer to it, and names that exist are answered as those that do not.

All that is foreign bears a mark that nobody can guess. Each request that names it is sent a second time with a name
that nobody has; but for the name the answers must be the same.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import hypothesis
import pytest
import schemathesis
from hypothesis import HealthCheck
from hypothesis import strategies as st
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from oracle_server.edge.tokens import Scope, add
from tests.whole.client import Frame, make_attach, make_clock, make_event, make_events
from tests.whole.harness import PATIENCE, Server

DOCUMENT = Path(__file__).parents[2] / "docs" / "openapi.json"
MARK = "zq7hidden4x"
"""In the names of all that a token bound to a spec may not know."""
MARK_OF_SESSIONS = "zq8hidden5x"
"""In those that a token bound to a session may not know, while one bound to their spec may."""
FOREIGN = {"spec": f"{MARK}-spec", "open": f"{MARK}-open", "closed": f"{MARK}-shut"}
OTHERS = {"open": f"{MARK_OF_SESSIONS}-open", "closed": f"{MARK_OF_SESSIONS}-shut"}
"""Sessions by the same spec as one's own."""
SPEC = """
id: {id}
description: about {id}
streams:
  - topic: /{topic}
    signals: {{v: msg.v}}
properties:
  - {{id: {property}, description: about {id}, formula: '{{v: 1}}'}}
"""
SCOPES: tuple[Scope, ...] = ("submit", "read", "admin")
BINDINGS: dict[str, dict[str, list[str]]] = {
    "spec": {"specs": ["own"]},
    "session": {"sessions": ["ours"]},
    "both": {"specs": ["own"], "sessions": ["ours"]},
}
TOKENS = [(scope, binding) for scope in SCOPES for binding in BINDINGS]


@dataclass
class Guarded:
    """A server whose tokens are bound, and on which others are at work."""

    server: Server
    secrets: dict[tuple[str, str], str]

    def headers(self, who: tuple[str, str]) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.secrets[who]}"}

    def ask(self, who: tuple[str, str], method: str, path: str, **more: Any) -> httpx.Response:
        return self.server.http.request(method, f"/api/v1/{path}", headers=self.headers(who), **more)

    async def talk(self, who: tuple[str, str], path: str, *frames: Frame) -> list[Any]:
        """What a WebSocket is answered until a frame that ends a conversation, with the status of a refusal."""
        url = self.server.url.replace("http", "ws", 1) + path
        said: list[Any] = []
        try:
            async with (
                asyncio.timeout(PATIENCE),
                connect(url, additional_headers=self.headers(who), proxy=None, open_timeout=PATIENCE) as socket,
            ):
                for frame in frames:
                    await socket.send(json.dumps(frame))
                async for text in socket:
                    said.append(json.loads(text))
                    if said[-1]["type"] in ("attached", "error") and len(frames) == 1:
                        break
                await socket.close()
                return [*said, socket.close_reason]
        except InvalidStatus as error:
            answer = error.response
            return [answer.status_code, (answer.body or b"").decode()]


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    folder = tmp_path_factory.mktemp("bound")
    specs, data = folder / "specs", folder / "data"
    specs.mkdir()
    data.mkdir()
    (specs / "own.yaml").write_text(SPEC.format(id="own", topic="a", property="p"))
    (specs / f"{MARK}.yaml").write_text(
        SPEC.format(id=FOREIGN["spec"], topic=f"{MARK}_topic", property=f"{MARK}_property")
    )
    (specs / f"{MARK}-unsound.yaml").write_text(f"id: {MARK}-unsound\n")
    secrets = {("admin", "none"): add(data / "tokens.json", "admin", ["admin"])}
    for scope, binding in TOKENS:
        bounds: Any = BINDINGS[binding]
        secrets[scope, binding] = add(data / "tokens.json", f"{scope}-{binding}", [scope], **bounds)
    with ExitStack() as stack:
        server = stack.enter_context(Server(specs, data, ORACLE_HISTORY="memory"))
        guarded = Guarded(server, secrets)
        asyncio.run(be_at_work(guarded))
        yield guarded
        assert server.alive


async def be_at_work(guarded: Guarded) -> None:
    """Have sessions of one's own, of others by the same spec, and of others by their own spec."""
    admin = ("admin", "none")
    topic = f"/{MARK}_topic"
    for session, spec, stream, monitor in (
        ("ours", "own", "/a", "m"),
        (OTHERS["open"], "own", "/a", f"{MARK_OF_SESSIONS}_monitor"),
        (OTHERS["closed"], "own", "/a", f"{MARK_OF_SESSIONS}_monitor"),
        (FOREIGN["open"], FOREIGN["spec"], topic, f"{MARK}_monitor"),
        (FOREIGN["closed"], FOREIGN["spec"], topic, f"{MARK}_monitor"),
    ):
        events = [make_event(seq, stream, seq, {"v": seq}, ask=True) for seq in (1, 2, 3)]
        attach = make_attach(monitor, session=session, spec=spec)
        said = await guarded.talk(
            admin, "/api/v1/attach", attach, make_events(*events), make_clock(stream, 10), {"type": "detach"}
        )
        assert said[-2]["type"] == "detached", said
    for session in (OTHERS["closed"], FOREIGN["closed"]):
        assert guarded.ask(admin, "DELETE", f"sessions/{session}").status_code == 200


def unknowable(binding: str) -> tuple[str, ...]:
    """The marks that a token bound so may not see."""
    return (MARK,) if binding == "spec" else (MARK, MARK_OF_SESSIONS)


def names_of(binding: str) -> list[str]:
    """Names of others' sessions that a token bound so may not know."""
    return [FOREIGN["open"], FOREIGN["closed"], *([] if binding == "spec" else OTHERS.values())]


def nobodys(name: str) -> str:
    """A name that nobody has, as long as one that somebody has."""
    return "nobody" + "s" * (len(name) - 6)


def told(status: int, headers: Any, text: str, name: str) -> tuple[Any, ...]:
    """An answer to a question about a name, without that name and the time."""
    kept = {k.lower(): str(v).replace(name, "NAME") for k, v in headers.items() if k.lower() != "date"}
    return status, kept, text.replace(name, "NAME")


def assert_silent(binding: str, *answers: object) -> None:
    for mark in unknowable(binding):
        assert mark not in str(answers)


described = schemathesis.openapi.from_path(DOCUMENT).exclude(path_regex="/stream$")


@described.given(who=st.sampled_from(TOKENS), chosen=st.integers(0, 3))
@described.parametrize()
@hypothesis.settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
def test_no_answer_tells_of_what_is_foreign(case: Any, guarded: Guarded, who: tuple[Scope, str], chosen: int) -> None:
    binding = who[1]
    names = names_of(binding)
    foreign = names[chosen % len(names)]
    places = [place for place in ("session_id", "spec_id") if place in (case.path_parameters or {})]
    body = case.body if isinstance(case.body, dict) else {}

    def call(session: str, spec: str) -> tuple[Any, ...]:
        for place in places:
            case.path_parameters[place] = session if place == "session_id" else spec
        if case.path == "/api/v1/sessions" and case.method == "POST" and body:
            case.body = body | {"spec": spec, "id": session}
        answer = case.call(base_url=guarded.server.url, headers=guarded.headers(who))
        headers = {name: ",".join(values) for name, values in answer.headers.items()}
        if session in names or spec == FOREIGN["spec"]:
            name = session if session in names else spec
            return told(answer.status_code, headers, answer.text, name)
        assert_silent(binding, headers, answer.text)
        return told(answer.status_code, headers, answer.text, nobodys(foreign) if session == nobodys(foreign) else spec)

    call("ours", "own")
    if places or body:
        about_session = call(foreign, "unlikely"), call(nobodys(foreign), "unlikely")
        about_spec = call("ours", FOREIGN["spec"]), call("ours", nobodys(FOREIGN["spec"]))
        for known, unknown in (about_session, about_spec):
            assert known == unknown
            assert_silent(binding, known)


@pytest.mark.parametrize("path", ["stream", "timeline/stream?width=1"])
@pytest.mark.parametrize("who", TOKENS, ids="-".join)
def test_streams_tell_of_nothing_foreign(guarded: Guarded, who: tuple[Scope, str], path: str) -> None:
    for name in names_of(who[1]):
        asked = {session: guarded.ask(who, "GET", f"sessions/{session}/{path}") for session in (name, nobodys(name))}
        known, unknown = (told(a.status_code, a.headers, a.text, session) for session, a in asked.items())
        assert known == unknown
        assert_silent(who[1], known)


@pytest.mark.parametrize("who", TOKENS, ids="-".join)
def test_what_is_of_all_is_not_for_the_bound(guarded: Guarded, who: tuple[Scope, str]) -> None:
    for path in ("/metrics", "/", "/docs", "/nowhere", f"/legacy/{FOREIGN['spec']}", "/readyz"):
        for method in ("GET", "HEAD", "OPTIONS", "PATCH"):
            answer = guarded.server.http.request(method, path, headers=guarded.headers(who))
            assert_silent(who[1], answer.headers, answer.text)
            assert "oracle_events" not in answer.text
    assert guarded.server.http.get("/metrics", headers=guarded.headers(who)).status_code == 403


@pytest.mark.parametrize("binding", BINDINGS)
async def test_monitors_are_told_of_nothing_foreign(guarded: Guarded, binding: str) -> None:
    who = ("submit", binding)
    spec = FOREIGN["spec"]
    pairs: list[tuple[str, Frame]] = [
        (name, {"session": name, "spec": s}) for name in names_of(binding) for s in (spec, None)
    ]
    if binding != "spec":  # else a new session is opened, and a name that is taken is not
        pairs += [(name, {"session": name, "spec": "own"}) for name in names_of(binding)]
    pairs += [(spec, {"session": "ours", "spec": spec}), (spec, {"spec": spec})]
    pairs += [(MARK, {"session": "ours", "spec": "own", "streams": [f"/{MARK}_topic"]})]
    for name, wanted in pairs:
        other = json.loads(json.dumps(wanted).replace(name, nobodys(name)))
        known = await guarded.talk(who, "/api/v1/attach", make_attach("m9", **wanted))
        unknown = await guarded.talk(who, "/api/v1/attach", make_attach("m9", **other))
        assert str(known).replace(name, "NAME") == str(unknown).replace(nobodys(name), "NAME")
        assert_silent(binding, str(known).replace(name, "NAME"))
    for path in (f"/legacy/{spec}", f"/legacy/{nobodys(spec)}", "/"):
        assert (await guarded.talk(who, path))[0] in (403, 404)
    legacy = [await guarded.talk(who, f"/legacy/{name}") for name in (spec, nobodys(spec))]
    assert legacy[0] == legacy[1]


@pytest.mark.parametrize("binding", BINDINGS)
async def test_what_others_do_changes_no_answer(guarded: Guarded, binding: str) -> None:
    """No total, number or list that a bound token reads has anything of others in it."""
    who, admin = ("read", binding), ("admin", "none")
    n = guarded.ask(who, "GET", "sessions/ours/verdicts").json()["items"][-1]["n"]
    paths = [
        "specs", "specs/own", "sessions/ours", "sessions/ours/verdicts", "sessions/ours/violations",
        f"sessions/ours/verdicts/{n}/explanation", "sessions/ours/trace", "sessions/ours/timeline",
        *(["sessions"] if binding != "spec" else []),
    ]  # fmt: skip

    def all_of_it() -> list[tuple[Any, ...]]:
        answers = [guarded.ask(who, "GET", path) for path in paths]
        assert {answer.status_code for answer in answers} == {200}
        return [told(a.status_code, a.headers, a.text, MARK) for a in answers]

    before = all_of_it()
    for turn in range(3):
        session = f"{MARK}-{binding}-{turn}"
        events = [make_event(seq, f"/{MARK}_topic", seq, {"v": seq}) for seq in range(1, 30)]
        attach = make_attach(f"{MARK}_monitor", session=session, spec=FOREIGN["spec"])
        await guarded.talk(admin, "/api/v1/attach", attach, make_events(*events), {"type": "detach"})
        put = guarded.ask(admin, "PUT", f"specs/{session}", content=SPEC.format(id=session, topic="x", property="q"))
        assert put.status_code == 201
        assert guarded.ask(admin, "DELETE", f"sessions/{session}").status_code == 200
    assert all_of_it() == before
