"""Every command on the documents' pages: it is run here, or listed with where else it is, or why it is not.

A page that is new has its commands run without further ado; what a reader has to have done before stands in `PAGES`.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import pytest
import typer
import yaml

from oracle_server.cli.commands import app
from tests.pages import CTRL_C, Reader, Step, steps
from tests.postgres import Postgres, programs
from tests.processes import ROOT

sys.path.append(str(ROOT / "adapters/common"))
from oracle_adapter import command as adapter

DOCUMENTS = [
    path.relative_to(ROOT).as_posix()
    for path in (
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *sorted(ROOT.glob("docs/*.md")),
        *sorted(ROOT.glob("examples/*/README.md")),
    )
]

ELSEWHERE: dict[str, list[str]] = yaml.safe_load((ROOT / "tests/not_run.yaml").read_text())
"""Commands that are not run here, as they stand on their pages, by why that is so."""
NOT_RUN = {command for commands in ELSEWHERE.values() for command in commands}

EXAMPLES = f"cp -rL {ROOT}/examples {ROOT}/specs ."
"""What `oracle-server init --examples .` does, in a hundredth of the time."""
BEGUN = (EXAMPLES, "oracle-server start --specs specs")
TRACE = "examples/battery_uav/traces/fault_wrong_status.jsonl"
FLOWN = f"curl -X POST -T {TRACE} 'http://127.0.0.1:8642/api/v1/recordings?spec=battery_uav&session=flight1'"
SESSION = (FLOWN, "oracle-server verdicts flight1")
FIRST = "import json, sys; print(json.load(sys.stdin)['items'][0]['id'])"
UPLOADED = f'curl http://127.0.0.1:8642/api/v1/recordings | python3 -c "{FIRST}"'


class Page(NamedTuple):
    """What a reader of a page has done before a command that begins so; and what is typed for what the page names."""

    before: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    stands_for: Mapping[str, str] = MappingProxyType({})


def commands(name: str) -> list[str]:
    return [step.command for step in steps((ROOT / name).read_text()) if step.command]


RUN = [
    name for name in DOCUMENTS if name != "docs/fleet.md" and any(command not in NOT_RUN for command in commands(name))
]

PAGES = {
    "README.md": Page(
        {
            ".venv/bin/oracle-server check": (
                BEGUN[0],
                "mkdir -p .venv/bin && ln -s $(command -v oracle-server) .venv/bin",
            ),
            "oracle-server verdicts flight1": SESSION[:1],
        }
    ),
    "docs/engine.md": Page({"oracle-server verdicts flight1": (*BEGUN, *SESSION)}),
    "docs/from-rosmonitoring.md": Page(
        {
            "oracle-server serve": (
                "mkdir specs",
                f"sed s/ROBOT/chat/g {ROOT}/oracle_server/starter/spec.yaml > specs/chat.yaml",
            )
        }
    ),
    "docs/operations.md": Page(
        {
            "oracle-server start": BEGUN[:1],
            "curl 'http": (BEGUN[1], *SESSION),
            "oracle-server serve --foxglove": ("oracle-server stop",),
        }
    ),
    "docs/recordings.md": Page(
        {
            "oracle-server replay 'bags": (
                f"mkdir -p specs bags/2026-11-30 more && cp {ROOT}/specs/battery_uav.yaml specs",
                f"cp -rL {ROOT}/examples .",
                BEGUN[1],
                FLOWN.replace("fault_wrong_status", "in_order"),
                "oracle-server verdicts flight1",
                "oracle-server record flight1 -o bags/2026-11-30/flight1.mcap",
                "cp examples/battery_uav/traces/in_order.jsonl more",
            ),
            "oracle-server replay specs/battery_uav.yaml flight": ("cp more/in_order.jsonl flight.jsonl",),
            "curl -T flight.bag": ("cp flight.jsonl flight.bag",),
            "curl http://127.0.0.1:8642/api/v1/recordings/ID": (f"ID=$({UPLOADED})",),
        },
        {"recordings/ID": "recordings/$ID"},
    ),
    "docs/security.md": Page(
        {
            "oracle-server serve": (
                "mkdir specs",
                "openssl req -x509 -newkey rsa:2048 -nodes -keyout server.key -out server.crt -subj /CN=oracle",
                "cp server.crt robots.crt",
            )
        }
    ),
    **dict.fromkeys((name for name in RUN if name.startswith("examples/")), Page({"oracle-server ": BEGUN[:1]})),
}
"""Pages that take something for done."""


def follow(reader: Reader, name: str, before: Mapping[str, tuple[str, ...]]) -> None:
    """Do all that a page has its reader do and that is not listed; what is to be done before is done once."""
    left = dict(before)
    done = [step for step in steps((ROOT / name).read_text()) if step.command not in NOT_RUN]
    assert any(step.command for step in done)
    for step in done:
        for beginning in [each for each in left if step.command.startswith(each)]:
            for command in left.pop(beginning):
                reader.does(Step(command, []))
        reader.does(step)
    assert not left, f"no such command: {[*left]}"


@pytest.mark.parametrize("name", RUN)
def test_a_page_shows_what_happens(name: str, tmp_path: Path) -> None:
    page = PAGES.get(name, Page())
    with Reader(tmp_path, page.stands_for) as reader:
        follow(reader, name, page.before)


def test_the_page_on_postgresql_shows_what_happens(tmp_path: Path) -> None:
    with ExitStack() as stack:
        postgres = stack.enter_context(Postgres())
        urls = {  # without the port, which is in the environment: to the shell, its `&` ended the command
            f"postgresql://{role}@db.example.org/oracle": f"postgresql://{role}@/oracle?host={postgres.folder}"
            for role in ("oracle", "robot7")
        }
        folder = programs()
        assert folder is not None
        reader = stack.enter_context(
            Reader(tmp_path, urls, str(folder), PGHOST=str(postgres.folder), PGPORT=str(postgres.port), PGUSER="tests")
        )
        anew = ("dropdb oracle", "createdb --owner=oracle --encoding=UTF8 --template=template0 oracle")
        before = {"oracle-server stop": (CTRL_C, *anew, *BEGUN, *SESSION), "createuser robot7": ("oracle-server stop",)}
        follow(reader, "docs/fleet.md", before)


def test_what_is_listed_is_on_a_page() -> None:
    there = {command for name in DOCUMENTS for command in commands(name)}
    assert there >= NOT_RUN
    assert PAGES.keys() <= set(RUN)
    named = {path for why in ELSEWHERE for path in re.findall(r"\b(?:tests|docs)/[\w/.]*\w", why)}
    assert named
    assert [path for path in named if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("name", DOCUMENTS)
def test_commands_stand_where_they_are_found(name: str) -> None:
    """In a block `console`, at its left, each behind a `$`."""
    text = (ROOT / name).read_text()
    assert re.findall(r"^ {4,}(?:\$ |(?:oracle-server|python3?|pip|curl|\./scripts/\w+) ).*", text, re.MULTILINE) == []
    assert re.findall(r"^ +```console|^```(?:sh|bash|shell)$", text, re.MULTILINE) == []
    assert [
        b for b in re.findall(r"^```console\n(.*?)^```$", text, re.MULTILINE | re.DOTALL) if not b.startswith("$ ")
    ] == []


def named(name: str) -> Iterator[list[str]]:
    """The words of each command of the server that a page names: in its blocks, and `so` in its text."""
    texts = [part for command in commands(name) for part in re.findall(r"\boracle-server (?!\.)(.*)", command)]
    for text in re.findall(
        r"(?<!`)`([^`\n]+)`", re.sub(r"^```.*?^```$", "", (ROOT / name).read_text(), flags=re.MULTILINE | re.DOTALL)
    ):
        if text.startswith("oracle-server "):
            texts.append(text.removeprefix("oracle-server "))
        elif re.match(r"[a-z]+ (?:\w+ )?.*--\w", text):
            texts.append(text)
    for text in texts:
        yield shlex.split(re.sub(r"[\[\]|…]", " ", text).partition(" > ")[0].partition("  #")[0])


@pytest.mark.parametrize("name", DOCUMENTS)
def test_the_commands_that_a_page_names_have_its_options(name: str) -> None:
    root: Any = typer.main.get_command(app)
    for words in named(name):
        command = root
        while words and words[0] in getattr(command, "commands", {}):
            command = command.commands[words.pop(0)]
        if command is root and not (words and words[0].startswith("-")):
            continue  # another program's
        known = {option for each in command.params for option in (*each.opts, *each.secondary_opts)} | {"-h", "--help"}
        assert [word for word in words if re.match(r"--?[a-z]", word) and word.partition("=")[0] not in known] == [], (
            words
        )


@pytest.mark.parametrize("ros", ["oracle_ros1", "oracle_ros2"])
def test_adapters_have_the_options_that_pages_name(ros: str) -> None:
    told = [command for name in DOCUMENTS for command in commands(name) if command.startswith(f"python3 -m {ros} ")]
    assert told
    for command in told:
        words = shlex.split(command.partition(" --ros-args")[0].partition(" >")[0].removesuffix("&"))[3:]
        if words != ["--dump-graph"]:  # which is not of both
            adapter.parser(ros, None).parse_args(words)
