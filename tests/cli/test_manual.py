"""The manual page says what the help says, and shells complete what there is."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.processes import ROOT
from tests.whole.harness import run


def told(page: str) -> list[tuple[str, set[str]]]:
    """Each command of a manual page with its options."""
    commands = re.split(r"^\.SS ", page, flags=re.MULTILINE)[1:]
    return [
        (text.split("\n", 1)[0], set(re.findall(r"^\.B .*?(\\-\\-[a-z\\-]+)", text, re.MULTILINE))) for text in commands
    ]


def test_the_manual_page_is_that_of_the_help() -> None:
    made = subprocess.run([sys.executable, ROOT / "scripts/manual"], check=True, capture_output=True, cwd=ROOT).stdout
    kept = (ROOT / "packaging/oracle-server.1").read_bytes()
    assert len(told(made.decode())) > 15
    how = "python scripts/manual > packaging/oracle-server.1"
    assert told(kept.decode()) == told(made.decode()), how
    assert kept.split(b"\n.S", 2)[1] == made.split(b"\n.S", 2)[1], how  # its name, and what it is


def test_the_short_form_of_help_is_known() -> None:
    for words in ((), ("check",), ("token", "add")):
        assert run(*words, "-h").stdout == run(*words, "--help").stdout != ""


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shells_are_told_how_to_complete(shell: str) -> None:
    script = run("--show-completion", shell, _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1").stdout
    assert "_ORACLE_SERVER_COMPLETE" in script


@pytest.mark.parametrize(
    ("shell", "typed"),
    [
        ("bash", {"COMP_WORDS": "oracle-server ses", "COMP_CWORD": "1"}),
        ("zsh", {"_TYPER_COMPLETE_ARGS": "oracle-server ses"}),
        ("fish", {"_TYPER_COMPLETE_ARGS": "oracle-server ses", "_TYPER_COMPLETE_FISH_ACTION": "get-args"}),
    ],
)
def test_commands_are_completed(shell: str, typed: dict[str, str]) -> None:
    """By what the shell's own script asks for; zsh and fish take a command with its help."""
    found = run(_ORACLE_SERVER_COMPLETE=f"complete_{shell}", **typed).stdout
    assert re.match(r"""(?:_arguments '\*: :\(\(")?sessions\b""", found)
    assert not re.search(r"\b(?:specs|verdicts)\b", found)
