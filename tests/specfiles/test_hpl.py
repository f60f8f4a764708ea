"""`import --hpl`: what properties become and judge, and those that stay unknown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.engines.table import make_engines
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.hpl.write import import_hpl
from oracle_server.specfiles.imported import Imported
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.lowered import lowered

ROOT = Path(__file__).parents[2]
CORPUS = ROOT / "tests" / "corpus" / "hpl"
SECOND = 10**9
Message = Mapping[str, Any]

few = settings(max_examples=30, deadline=None)


def imported(folder: Path, text: str) -> tuple[str, Imported]:
    """The spec of a text of HPL, and what is told of it."""
    (folder / "it.hpl").write_text(text)
    told = import_hpl(folder / "it.hpl", folder / "it.yaml", Types(()))
    return (folder / "it.yaml").read_text(), told


def patterns(spec: str) -> dict[str, str]:
    return {p.id: p.text for p in parse_spec(spec, "it.yaml").spec.properties}


def test_what_share_a_topic_is_warned_of_at_its_place(tmp_path: Path) -> None:
    text = (
        "globally: /m {v = 1} causes /m {v = 2}\n"
        "globally: /m {v > 0} causes /m {ok} within 1 s\n"
        "after /m {v = 1} until /m {ok}: no /n\n"
    )
    spec, told = imported(tmp_path, text)
    places = [(f.line, f.column) for f in told.findings if f.file.endswith(".hpl")]
    assert places == [(2, 29), (3, 24)]
    assert spec.count("# look at it: /m is the topic of an event before too") == 2
    assert not told.done


@pytest.mark.parametrize(
    "text", ["/b requires /b", "/b {x} requires /b", "/b {x and y} causes /b {x}", "/b forbids /b {x}", "/b causes /b"]
)
def test_what_would_answer_itself_at_each_message_is_unknown(tmp_path: Path, text: str) -> None:
    spec, told = imported(tmp_path, f"globally: {text} within 1 s")
    assert "would answer itself" in spec
    assert not told.judges


# properties, against a reading by brute force


def violated(spec: str, trace: list[tuple[float, str, Message]]) -> list[bool]:
    """Whether the only property has been violated by each event, in the order of arrival."""
    ready = plan(parse_spec(spec + "ordering: {by: arrival}\n", "it.yaml").spec)
    session = Session(ready, make_engines(ready))
    found, bad = list[bool](), False
    for n, (time, topic, data) in enumerate(trace):
        now = 10**18 + int(time * SECOND)
        for judged in session.ingest(Event(StreamKey(topic, "topic"), "m", n + 1, now, now, data)):
            bad = bad or judged.verdicts[0].outcome in NEGATIVE
        found.append(bad)
    return found


Row = tuple[float, str, Message]
Holds = Callable[[Message, Message], bool]
RELATIONS: dict[str, Holds] = {
    "x = @A.x": lambda m, a: bool(m["x"] == a["x"]),
    "@A.x + 1 = x and y": lambda m, a: bool(a["x"] + 1 == m["x"] and m["y"]),
    "x = @A.x and y = @A.y": lambda m, a: bool(m["x"] == a["x"] and m["y"] == a["y"]),
    "x > @A.x": lambda m, a: bool(m["x"] > a["x"]),
    "2 * @A.x >= x": lambda m, a: bool(2 * a["x"] >= m["x"]),
}
LIMIT = 2.5


def _by_force(verb: str, holds: Holds, rows: list[Row], now: float) -> bool:
    """Whether the property of a verb is violated by these events, at a time."""

    def pairs(i: int, first: str, second: str, *, back: bool = False) -> bool:
        """Whether some event goes with that of a place: after it, or before it, in time."""
        time, _, data = rows[i]
        span = rows[:i] if back else rows[i + 1 :]
        return any(
            topic == second and abs(t - time) < LIMIT and (holds(data, d) if first == "/m" else holds(d, data))
            for t, topic, d in span
        )

    places = range(len(rows))
    if verb == "causes":
        return any(rows[i][1] == "/a" and not pairs(i, "/a", "/m") and rows[i][0] + LIMIT < now for i in places)
    if verb == "forbids":
        return any(rows[i][1] == "/a" and pairs(i, "/a", "/m") for i in places)
    # `/a as A requires /m {…}`
    return any(rows[i][1] == "/a" and not _earlier(rows, i, holds) for i in places)


def _earlier(rows: list[Row], i: int, holds: Holds) -> bool:
    time, _, data = rows[i]
    return any(topic == "/m" and time - t < LIMIT and holds(d, data) for t, topic, d in rows[:i])


ROWS = st.lists(
    st.tuples(
        st.sampled_from((0, 0, 1, 1, 2, 4)),
        st.sampled_from(("/a", "/m")),
        st.fixed_dictionaries({"x": st.integers(0, 2), "y": st.booleans()}),
    ),
    min_size=1,
    max_size=9,
)


def _timed(rows: list[tuple[int, str, Message]]) -> list[Row]:
    now, found = 0.0, []
    for pause, topic, data in rows:
        now += pause
        found.append((now, topic, data))
    return found


ALIASES = [
    (verb, r) for verb in ("causes", "forbids", "requires") for r in RELATIONS if verb == "causes" or ">" not in r
]


@pytest.mark.parametrize(("verb", "relation"), ALIASES)
def test_an_alias_is_the_message_that_it_names(
    tmp_path_factory: pytest.TempPathFactory, verb: str, relation: str
) -> None:
    text = f"globally: /a as A {verb} /m {{{relation}}} within 2500 ms"
    spec, told = imported(tmp_path_factory.mktemp("hpl"), text)
    assert told.judges
    holds = RELATIONS[relation]

    @few
    @given(ROWS)
    def check(rows: list[tuple[int, str, Message]]) -> None:
        trace = _timed(rows)
        wanted = [_by_force(verb, holds, trace[: n + 1], trace[n][0]) for n in range(len(trace))]
        assert violated(spec, trace) == wanted

    check()


@pytest.mark.parametrize("closes", [False, True])
def test_what_opens_a_scope_is_the_first_message_and_not_a_later_one(tmp_path: Path, closes: bool) -> None:
    scope = "after /p as P until /q" if closes else "after /p as P"
    spec, told = imported(tmp_path, f"{scope}: no /m {{x = @P.x}}")
    assert told.done

    @few
    @given(st.lists(st.tuples(st.sampled_from(("/p", "/m", "/q" if closes else "/p")), st.integers(0, 2)), max_size=12))
    def check(rows: list[tuple[str, int]]) -> None:
        opened: int | None = None
        bad, wanted = False, []
        for topic, x in rows:
            if topic == "/q":
                opened = None
            elif topic == "/p":
                opened = x if opened is None else opened
            bad = bad or (topic == "/m" and x == opened)
            wanted.append(bad)
        assert violated(spec, [(n, topic, {"x": x}) for n, (topic, x) in enumerate(rows)]) == wanted

    check()


@pytest.mark.parametrize("scope", ["after /p {y}", "after /p {y} until /q", "after (/p {y} or /r) until /q"])
@pytest.mark.parametrize(
    "body", ["no /p {x = 1}", "some /p {x = 1} within 2500 ms", "/p {x = 1} causes /m within 2500 ms"]
)
def test_the_message_that_opens_a_scope_is_not_in_it(
    tmp_path_factory: pytest.TempPathFactory, scope: str, body: str
) -> None:
    spec, told = imported(tmp_path_factory.mktemp("hpl"), f"{scope}: {body}")
    assert told.done

    @few
    @given(
        st.lists(st.tuples(st.sampled_from((0, 1, 2, 4)), st.sampled_from("pppmqr"), st.integers(0, 1), st.booleans()))
    )
    def check(rows: list[tuple[int, str, int, bool]]) -> None:
        now, opened, waits = 0.0, False, list[float]()
        bad, trace, wanted = False, list[Row](), []
        for pause, letter, x, y in rows:
            topic = f"/{letter}"
            if topic not in spec:
                continue
            now += pause
            trace.append((now, topic, {"x": x, "y": y}))
            bad = bad or any(time + LIMIT < now for time in waits)
            if opened and letter == "q":
                bad, opened, waits = bad or bool(waits), False, []
            elif opened and letter == "p" and x == 1:
                bad = bad or body.startswith("no")
                waits = [*waits, now] if "causes" in body else []
            elif opened and letter == "m" and "causes" in body:
                waits = []
            elif not opened and ((letter == "p" and y) or letter == "r"):
                opened, waits = True, [now] if body.startswith("some") else []
            wanted.append(bad)
        assert violated(spec, trace) == wanted

    check()


BODIES = ("no /b", "some /b {x}", "/a causes /b", "/b requires (/a or /b2 {x})", "/a {x} forbids /b")
SCOPES = ("globally", "after /p", "until /q {x}", "after /p {x} until (/q or /r)")


def test_each_scope_and_pattern_is_that_of_a_pattern_written_here(tmp_path: Path) -> None:
    said = [
        f"{scope}: {body}{within}"
        for scope in SCOPES
        for body in BODIES
        for within in ("", " within 5 s", " within .5s")
    ]
    spec, told = imported(tmp_path, "\n".join(said))
    by_hand = {f"p{i + 1}": text.replace(".5s", "500ms").replace("5 s", "5s") for i, text in enumerate(said)}
    written = spec.split("properties:")[0] + "properties:\n"
    written += "".join(f"  - {{id: {name}, latch: true, pattern: '{text}'}}\n" for name, text in by_hand.items())
    ours, theirs = (parse_spec(each, "it.yaml").spec.properties for each in (spec, written))
    assert not told.todos
    assert list(lowered(ours)) == list(lowered(theirs))
    assert all(prop.latch for prop in ours)


# what has no counterpart


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("globally: no /b {x ** 2 > 1}", "there is no `**` (line 1, column 18)"),
        ("globally: no /b {sin(x) > 1}", "no function `sin` (line 1, column 18)"),
        ("globally: no /b {x < INF}", "`INF`"),
        ("globally: no /b {state = PRESSED}", "`PRESSED` looks like a constant"),
        ("globally: no /b {s.level = s.WARN}", "`WARN` looks like a constant"),
        ("globally: no /b {exists v in list: @v > 1}", "may be an index or an element"),
        ("globally: no /b {forall i in [1 to 4]: list[@i] > 1}", "over a set, or over all of an array"),
        ("globally: no ~b", "which node's is `~b`?"),
        ("globally: /b as B requires /a {x < @B.x}", "`<` between two messages"),
        ("after /p as P: no /b {x != @P.x}", "compared by `=`"),
        ("after /p as P: no /b {x = @P.x or y}", "compared by `=`"),
        ("globally: /a as A causes /b {x + @A.x = 1}", "those of one other message"),
        ("after /p as P: /a as A causes /b {@A.x = @P.x}", "those of one other message"),
        ("after /p as P until /q {x = @P.x}: no /b", "what closes a scope"),
        ("after /p as P {x} until /p {y}: no /b {x = @P.x}", "may open and close the scope"),
        ("after /p until /p {x}: no /b", "would both open the scope and close it"),
        ("globally: /a causes /b {x = @A.x}", "no message that comes before is called `A`"),
        ("globally: /a {x = @B.x} causes /b as B", "no message that comes before is called `B`"),
        ("globally: (/a as A or /c) causes /b {x = @A.x}", "one of several events"),
        ("after /p as A: /a as A causes /b {x = @A.x}", "two messages are called `A`"),
        ("globally: no /b {x + 1}", "no condition that holds or not (line 1, column 18)"),
        ("globally: no /b {y and len(x)}", "no condition that holds or not (line 1, column 24)"),
        ("globally: no /b {-x and y}", "no condition"),
        ("globally: no /b {x = 99999999999999999999999}", ""),
    ],
)
def test_what_has_no_counterpart_is_unknown_with_its_reason(tmp_path: Path, text: str, reason: str) -> None:
    spec, told = imported(tmp_path, text)
    assert reason in spec
    assert patterns(spec) == {"p1": "{todo}"}
    assert not told.judges
    assert told.todos == ("the pattern of p1",)
    topics = [t for t in parse_spec(spec, "it.yaml").spec.by_key if t.name != "/todo"]
    for topic in topics:
        ready = plan(parse_spec(spec, "it.yaml").spec)
        session = Session(ready, make_engines(ready))
        judged = session.ingest(Event(topic, "m", 1, SECOND, SECOND, {})) + session.finish(9 * SECOND)
        assert [v.outcome for j in judged for v in j.verdicts] == ["unknown"]


def test_what_is_read_is_judged_beside_what_is_not(tmp_path: Path) -> None:
    spec, told = imported(tmp_path, "globally: no /a {x > 1}\nglobally: no /a {x ** 2 > 1}")
    assert told.judges
    assert patterns(spec) == {"p1": 'globally: no /a {"x > 1"}', "p2": "{todo}"}
