"""What a page has its reader do, done: files are saved, commands typed, and what they print is as shown.

A file is a block under a line that ends with its name: "`spec.yaml`:". Commands are the lines of a `console` block that
begin with `$`, in one shell, and what they print stands below them: each line shown is printed, and each line printed
is shown; `…` stands for anything, and a line of it for any lines. Where nothing is shown, nothing is compared. A
command ends with 0, unless the next one is `echo $?`.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple, Self

from tests.processes import PATIENCE, environment, held_port

BLOCK = re.compile(r"(?:`([\w.-]+)`:\n\n)?^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
ADDRESS = "http://127.0.0.1:8642"
"""Where the server of a page is; in the test it is elsewhere."""
READS = ("oracle-server verdicts", "oracle-server sessions")
"""What shows how a session stands, which a reader asks again until the session is as far."""


class Step(NamedTuple):
    """A file that is saved, or a command with the lines below it."""

    command: str
    shown: list[str]
    file: str = ""
    ends: bool = True
    """Whether the command ends with 0."""


def steps(text: str) -> Iterator[Step]:
    """All that a page has its reader do, in its order."""
    typed: list[Step] = []
    for name, language, block in BLOCK.findall(text):
        if name:
            typed.append(Step("", block.splitlines(), name))
        elif language == "console":
            for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
                command, *shown = part.splitlines()
                typed.append(Step(re.sub(r"\s{2,}# .*", "", command).strip(), shown))
    for step, after in zip(typed, [*typed[1:], Step("", [])], strict=False):
        yield step._replace(ends=after.command != "echo $?")


class Reader:
    """A shell in a folder with a server's place of its own; use it as a context manager."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        port = held_port(self._stack)
        self._address = f"http://127.0.0.1:{port}"
        path = f"{Path(sys.executable).parent}:/usr/bin:/bin"
        settings = environment(
            PATH=path,
            ORACLE_PORT=str(port),
            ORACLE_URL=self._address,
            ORACLE_DATA_DIR=str(self._folder / "data"),
            HOME=str(self._folder),
        )
        (self._folder / "here").mkdir()
        self._shell = subprocess.Popen(
            ["bash", "--norc"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            cwd=self._folder / "here",
            env=settings,
        )
        self._stack.callback(self._close, settings)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _close(self, settings: dict[str, str]) -> None:
        self._shell.kill()
        self._shell.communicate()
        subprocess.run(["oracle-server", "stop"], env=settings, check=False, capture_output=True)

    def does(self, step: Step) -> None:
        """Do a step, and find what is shown."""
        if step.file:
            self.save(step.file, "\n".join(step.shown) + "\n")
            return
        end = time.monotonic() + PATIENCE
        while True:
            printed, status = self.types(step.command)
            differs = difference(step.shown, printed)
            if (not differs and (status == 0) == step.ends) or not step.command.startswith(READS):
                break
            assert time.monotonic() < end, f"$ {step.command}\n{differs}\n{printed}"
        assert not differs, f"$ {step.command}\n{differs}"
        assert (status == 0) == step.ends, f"$ {step.command}\nended with {status}:\n{printed}"

    def save(self, name: str, text: str) -> None:
        """Save a file in the folder where the shell is."""
        place = self.types("pwd")[0].strip()
        (Path(place) / name).write_text(text, encoding="utf-8")

    def types(self, command: str) -> tuple[str, int]:
        """What a command prints, and its exit status, which `$?` is for the next one."""
        assert self._shell.stdin is not None
        assert self._shell.stdout is not None
        command = command.replace(ADDRESS, self._address)
        self._shell.stdin.write(f"{command}\n( s=$?; printf '\\n\\036%s\\n' $s; exit $s )\n")
        self._shell.stdin.flush()
        lines: list[str] = []
        for line in self._shell.stdout:
            if line.startswith("\x1e"):
                return "".join(lines).replace(self._address, ADDRESS), int(line[1:])
            lines.append(line)
        raise AssertionError(f"the shell ended at: {command}")


def difference(shown: list[str], printed: str) -> str:
    """What is shown and not printed, or printed and not shown; nothing where they agree, or where nothing is shown."""
    said = [words(line) for line in printed.splitlines() if line.strip()]
    wanted = [words(line) for line in shown if line.strip()]
    if not wanted:
        return ""
    patterns = [re.escape(line).replace("…", ".*") for line in wanted if line != "…"]
    missing = [pattern for pattern in patterns if not any(re.fullmatch(pattern, line) for line in said)]
    more = [line for line in said if not any(re.fullmatch(pattern, line) for pattern in patterns)]
    if missing or (more and "…" not in wanted):
        return f"shown and not printed: {missing}\nprinted and not shown: {more}"
    return ""


def words(line: str) -> str:
    """A line without how it is spaced."""
    return " ".join(line.split())
