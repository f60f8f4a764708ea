"""How far a long command has got: shown on standard error, where that is a terminal, and cleared at the end."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text


class Show(Protocol):
    """Is told how much is done, of how much (None where that is not known), and how many items that were."""

    def __call__(self, done: float, total: float | None, count: int, what: str | None = None) -> None:
        """`what` it is, where that has changed."""
        ...


_SECOND = 1.0


class _Rate(ProgressColumn):
    """Items a second."""

    def render(self, task: Task) -> Text:
        count, unit = task.fields["count"], task.fields["unit"]
        if not unit or not count or not task.elapsed:
            return Text("")
        return Text(f"{count / task.elapsed:,.0f} {unit}/s")


class _Time(TimeRemainingColumn):
    """The time left; where that is not known, the time since the start."""

    def render(self, task: Task) -> Text:
        if task.total is None:
            return Text(f"{task.elapsed or 0:.0f} s")
        return Text("left ") + super().render(task)


def _show_nothing(done: float, total: float | None, count: int, what: str | None = None) -> None:
    """Nobody watches."""
    del done, total, count, what


@contextmanager
def progress(what: str, unit: str = "", after: float = _SECOND) -> Iterator[Show]:
    """Show progress in what is named `what` once it has taken `after` seconds; yields what is to be told of it."""
    if not sys.stderr.isatty():
        yield _show_nothing
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), _Rate(), _Time())
    bar = Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False, redirect_stderr=False)
    task = bar.add_task(what, total=None, count=0, unit=unit)
    timer = threading.Timer(after, bar.start)
    timer.daemon = True
    if after:
        timer.start()
    else:
        bar.start()

    def show(done: float, total: float | None, count: int, what: str | None = None) -> None:
        bar.update(task, completed=done, total=total, count=count, description=what)

    try:
        yield show
    finally:
        timer.cancel()
        if after and timer.is_alive():
            timer.join()
        bar.stop()
