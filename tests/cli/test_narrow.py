"""Every table fits a terminal of 80 columns, whatever things are called, and has colour on terminals only."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from oracle_server.cli.client import Client
from oracle_server.cli.episodes import show_episodes
from oracle_server.cli.tables import show_sessions, show_specs, show_tokens, show_verdicts
from oracle_server.cli.top import show_top, watch_sessions
from oracle_server.edge.tokens import Token
from oracle_server.process.tables import print_table, table
from oracle_server.replay.command import run_replay
from oracle_server.replay.many.command import run_many
from tests.processes import PATIENCE
from tests.whole.harness import COMMAND, STRICT, Server, environment

LONG = "a_session_of_the_robot_in_the_hall_on_the_left_behind_the_doors"
PROPERTY = "the_speed_stays_below_what_was_agreed_on_for_all_of_the_robots"
SPEC = f"""\
id: a_spec_for_the_robots_in_the_hall_on_the_left_behind_the_doors
description: A description of what is required of the robots in the hall, which is of some length, too
streams:
  - topic: /robots/in_the_hall/on_the_left/behind_the_doors/cmd_vel
    signals: {{the_forward_speed_of_the_robot_in_metres_each_second: msg.x}}
properties:
  - id: {PROPERTY}
    formula: '{{the_forward_speed_of_the_robot_in_metres_each_second <= 1}}'
"""
TOPIC = "/robots/in_the_hall/on_the_left/behind_the_doors/cmd_vel"
EVENT = f'{{{{"stream": "{TOPIC}", "kind": "topic", "stamp": {{}}, "data": {{{{"x": {{}}}}}}}}}}\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("narrow")
    (folder / "spec.yaml").write_text(SPEC, encoding="utf-8")
    times = [1_764_000_000_000_000_000 + n * 10**9 for n in range(3)]
    events = "".join(EVENT.format(stamp, speed) for stamp, speed in zip(times, (0, 2, 0), strict=True))
    (folder / "trace.jsonl").write_text(events, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def judged(folder: Path, server: Server) -> Iterator[Client]:
    """A server with a session that has a violation."""
    spec = re.search(r"id: (\S+)", SPEC)
    assert spec is not None
    put = server.http.put(f"/api/v1/specs/{spec[1]}", content=SPEC)
    assert put.status_code in (200, 201), put.text
    sent = server.http.post(
        "/api/v1/recordings",
        params={"spec": spec[1], "session": LONG},
        content=(folder / "trace.jsonl").read_bytes(),
    ).json()
    while (one := server.get(f"recordings/{sent['id']}"))["state"] != "judged":
        assert one["state"] in ("queued", "judging"), one
    client = Client(server.url)
    yield client
    client._http.close()


@pytest.fixture
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")


def fits(printed: str, *names: str) -> None:
    """All of it is in 80 columns, and has all of each name, in one piece or in several."""
    assert [line for line in printed.splitlines() if len(line) > 80] == []
    for name in names:
        letters = iter(re.sub(r"\s", "", printed))
        assert all(letter in letters for letter in name), name


@pytest.mark.usefixtures("narrow")
def test_tables_of_a_server_fit(judged: Client, capsys: pytest.CaptureFixture[str]) -> None:
    for show in (show_sessions, show_specs):
        show(judged, as_json=False)
        fits(capsys.readouterr().out, *([LONG] if show is show_sessions else []))
    for watch in (show_top, watch_sessions):
        watch(judged)
        fits(capsys.readouterr().out, "session")
    show_verdicts(judged, LONG, [PROPERTY], [], as_json=False)
    fits(capsys.readouterr().out, PROPERTY)


@pytest.mark.usefixtures("narrow")
def test_tables_with_texts_below_them_fit(judged: Client, capsys: pytest.CaptureFixture[str]) -> None:
    def printed() -> None:
        *tables, texts = capsys.readouterr().out.split("\n\n")
        assert PROPERTY in texts
        fits("\n".join(tables), PROPERTY)

    show_verdicts(judged, LONG, [], [], as_json=False)
    printed()
    for session in (LONG, None):
        show_episodes(judged, session, [], only_open=False, as_json=False)
        printed()


@pytest.mark.usefixtures("narrow")
def test_tables_of_replays_fit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, trace = folder / "spec.yaml", folder / "trace.jsonl"
    assert run_replay([spec], trace, None, "text", signals=True) == 1
    violation, _, rest = capsys.readouterr().out.partition("\n")
    assert violation.startswith("violation: ")
    fits(rest, PROPERTY)
    assert run_many([trace], [spec]) == 1
    many = capsys.readouterr().out
    fits(many[many.index("property ") :], PROPERTY)


@pytest.mark.usefixtures("narrow")
def test_a_table_of_tokens_fits(capsys: pytest.CaptureFixture[str]) -> None:
    show_tokens(
        [Token(name=LONG, sha256="0" * 64, scopes=frozenset({"read"}), sessions=frozenset({LONG}))], as_json=False
    )
    fits(capsys.readouterr().out, LONG)


@pytest.mark.parametrize("width", [80, 200])
def test_words_are_broken_apart_before_names_are(width: int) -> None:
    out = io.StringIO()
    rows = [("a_property_with_some_length", "currently_false", "12", "step 394, 14:31:07.250Z", "0")]
    made = table(("property", "outcome", "violations", "first at", "unknown"), rows, width)
    Console(file=out, width=width).print(made)
    assert "a_property_with_some_length" in out.getvalue()
    assert ("step 394, 14:31:07.250Z" in out.getvalue()) == (width > 80)


def on_a_terminal(*words: str | Path, **settings: str) -> str:
    """What a command prints on a terminal."""
    ours, theirs = pty.openpty()
    env = environment(**STRICT, TERM="xterm-256color", **settings)
    with subprocess.Popen([COMMAND, *words], stdin=theirs, stdout=theirs, stderr=theirs, env=env) as command:
        os.close(theirs)
        drawn = b""
        try:
            while data := os.read(ours, 4096):
                drawn += data
        except OSError:  # its end on Linux
            pass
        command.wait(PATIENCE)
    os.close(ours)
    return drawn.decode()


@pytest.mark.parametrize(("settings", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False)], ids=["", "not wanted"])
def test_a_terminal_has_colour(settings: dict[str, str], coloured: bool, folder: Path) -> None:
    (folder / "bad.jsonl").write_text(EVENT.format(10**18, 2), encoding="utf-8")
    told = on_a_terminal("replay", folder / "spec.yaml", folder / "bad.jsonl", **settings)
    assert "currently_false" in told
    assert ("\x1b[31mcurrently_false" in told) == coloured


def test_elsewhere_there_is_none() -> None:
    out = io.StringIO()
    print_table(("outcome",), [("currently_false",)], out)
    assert out.getvalue().split() == ["outcome", "currently_false"]


def test_a_width_that_is_not_known_is_none(folder: Path) -> None:
    """Shells and editors say so by COLUMNS=0; of a table in no columns nothing was printed."""
    command = ["replay", str(folder / "spec.yaml"), str(folder / "trace.jsonl")]
    piped = subprocess.run(
        [COMMAND, *command], capture_output=True, text=True, env=environment(COLUMNS="0"), check=False
    )
    assert PROPERTY in piped.stdout.partition("violations")[2]
    assert "violations" in on_a_terminal(*command, COLUMNS="0")


def test_nothing_is_read_of_texts() -> None:
    out = io.StringIO()
    print_table(("a", "b"), [("[red]a[/red]", "\x1b[31m")], out)
    assert "[red]a[/red]" in out.getvalue()
    assert "\x1b" not in out.getvalue()
