"""What a page has its reader do, done: files are saved, commands typed, and what they print is as shown.

A file is a block under a line that ends with its name: "`spec.yaml`:". Commands are the lines of a `console` block that
begin with `$`, in one shell, and what they print stands below them: each line shown is printed, and each line printed
is shown; `…` stands for anything, and a line of it for any lines. Where nothing is shown, nothing is compared. A
command ends with 0, unless the next one is `echo $?`, or its comment says with what it ends. A server in the foreground
runs until the next one, or the page, ends.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple, Self

from tests.processes import PATIENCE, Process, environment, held_port

BLOCK = re.compile(r"(?:`([\w.-]+)`:\n\n)?^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
ADDRESS = "http://127.0.0.1:8642"
"""Where the server of a page is; in the test it is elsewhere."""
PORTS = ("8642", "8080", "8765")
"""Ports that pages name; in the test there are others in their places."""
ENDLESS = re.compile(r"(?:\w+=\S+ )*oracle-server (serve|replay --serve)\b")
"""What goes on until somebody ends it."""
CTRL_C = "^C"
"""Ends that."""
READS = ("oracle-server verdicts", "oracle-server sessions", "curl --silent http://127.0.0.1:8642/metrics")
"""What shows how a session, or the server, stands, which a reader asks again until it is as far."""


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
        if name and language != "console":
            typed.append(Step("", block.splitlines(), name))
        elif language == "console":
            for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
                line, *shown = part.splitlines()
                command, _, comment = re.sub(r"\s{2,}# ", "\0", line).partition("\0")
                typed.append(Step(command.strip(), shown, ends=not re.search(r"\bends with [1-9]", comment)))
    for step, after in zip(typed, [*typed[1:], Step("", [])], strict=False):
        yield step._replace(ends=step.ends and after.command != "echo $?")


class Reader:
    """A shell in an empty home with a server's place of its own; use it as a context manager.

    `stands_for` has what is typed in place of what a page names; `path` the folders of programs that the page takes for
    installed.
    """

    def __init__(self, folder: Path, stands_for: Mapping[str, str] | None = None, path: str = "", **more: str) -> None:
        self._folder, self._more = folder, more
        self._words = dict(stands_for or {})
        self._path = ":".join(each for each in (str(Path(sys.executable).parent), path, "/usr/bin:/bin") if each)
        self._stack = ExitStack()
        self._server: Process | None = None
        self._started = False

    def __enter__(self) -> Self:
        self._words |= {port: str(held_port(self._stack)) for port in PORTS}
        url = self._here(ADDRESS)
        self._settings = environment(
            ("XDG_STATE_HOME",),
            PATH=self._path,
            HOME=str(self._folder),
            ORACLE_URL=url,
            ORACLE_PORT=url.rpartition(":")[2],
            **self._more,
        )
        (self._folder / "here").mkdir()
        self._shell = subprocess.Popen(
            ["bash", "--norc"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            cwd=self._folder / "here",
            env=self._settings,
        )
        self._stack.callback(self._close)
        self.types('curl() { command curl --fail-with-body --silent --show-error "$@"; }')
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with self._stack:
            if kind is None:
                self._end()

    def _close(self) -> None:
        self._shell.kill()
        self._shell.communicate()
        if self._server is not None:
            self._server.remove()
        if self._started:
            subprocess.run(["oracle-server", "stop"], env=self._settings, check=False, capture_output=True)

    def does(self, step: Step) -> None:
        """Do a step, and find what is shown."""
        if step.file:
            self.save(step.file, "\n".join(step.shown) + "\n")
            return
        if step.command == CTRL_C or ENDLESS.match(step.command):
            self._end()
            if step.command != CTRL_C:
                self._begin(step)
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
        self._started |= "oracle-server start" in command
        self._shell.stdin.write(f"{self._here(command)}\n( s=$?; printf '\\n\\036%s\\n' $s; exit $s )\n")
        self._shell.stdin.flush()
        lines: list[str] = []
        for line in self._shell.stdout:
            if line.startswith("\x1e"):
                return self._there("".join(lines)), int(line[1:])
            lines.append(line)
        raise AssertionError(f"the shell ended at: {command}")

    def _begin(self, step: Step) -> None:
        """Start what does not end by itself, and wait until it has said what is shown; a server is ready then."""
        place = self.types("pwd")[0].strip()
        words = ["env", "-C", place, "bash", "-c", f"exec env {self._here(step.command)}"]
        self._server = Process(step.command, words, self._settings)
        if "oracle-server serve" in step.command:
            self._server.said("accepting work")
        for line in step.shown:
            self._server.said(pattern(self._here(line)).replace("\\ ", r"\s+"))

    def _end(self) -> None:
        """End what was begun; a server ends with 0."""
        if self._server is not None:
            name, status = self._server.name, self._server.end()
            assert status in ((0,) if "oracle-server serve" in name else (0, 1)), self._server.log
            self._server = None

    def _here(self, text: str) -> str:
        """What a page has, as it is in the test."""
        return _replaced(text, self._words)

    def _there(self, text: str) -> str:
        """What the test has, as it is on a page."""
        return _replaced(text, {here: word for word, here in self._words.items()})


def _replaced(text: str, words: Mapping[str, str]) -> str:
    """A text with others in place of some words, all at once: a port may have in it another one that a page names."""
    longest = sorted(words, key=len, reverse=True)
    return re.sub("|".join(map(re.escape, longest)), lambda found: words[found[0]], text) if words else text


def difference(shown: list[str], printed: str) -> str:
    """What is shown and not printed, or printed and not shown; nothing where they agree, or where nothing is shown."""
    said = [words(line) for line in printed.splitlines() if line.strip()]
    wanted = [words(line) for line in shown if line.strip()]
    if not wanted:
        return ""
    patterns = [pattern(line) for line in wanted if line != "…"]
    missing = [each for each in patterns if not any(re.fullmatch(each, line) for line in said)]
    more = [line for line in said if not any(re.fullmatch(each, line) for each in patterns)]
    if missing or (more and "…" not in wanted):
        return f"shown and not printed: {missing}\nprinted and not shown: {more}"
    return ""


def pattern(line: str) -> str:
    """What matches a line that is shown."""
    return re.escape(words(line)).replace("…", ".*")


def words(line: str) -> str:
    """A line without how it is spaced."""
    return " ".join(line.split())
