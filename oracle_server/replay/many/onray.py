"""Judges recordings on a Ray cluster, one a task; every machine of it has to find them by the same paths."""

from __future__ import annotations

import functools
import math
import os
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from oracle_server.core.errors import OracleError
from oracle_server.extras import install
from oracle_server.replay.many.judging import Judge, Question, Task, Unit, failed
from oracle_server.replay.many.workers import Ended, Said

_LOOK_EVERY = 5.0
"""Seconds between two looks at whether a recording takes too long."""


class RayError(OracleError):
    """Ray is not there."""


class RayCluster:
    """The cluster that `RAY_ADDRESS` names, or that was started on this machine, or else one of this process's own."""

    def __init__(self, question: Question, count: int | None, timeout: float | None) -> None:
        """By so many tasks at once, None for one a core; `timeout` (s) as for processes. Raises `RayError`."""
        try:
            import ray
        except ImportError:
            raise RayError(
                f"--engine ray needs the package ray; install it: `{install('ray')}`, on each machine "
                "of the cluster; -j needs nothing"
            ) from None
        self._ray: Any = ray
        self._question, self._count, self._timeout = question, count, timeout

    def run(self, tasks: Sequence[Task]) -> Iterator[Said]:
        """What is said of the recordings, in any order; all of it of one before its `Ended`."""
        self._join()
        try:
            yield from self._run(tasks)
        finally:
            self._ray.shutdown()

    def _join(self) -> None:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        quiet = {"log_to_driver": False, "logging_level": "ERROR", "configure_logging": True}
        try:
            try:
                self._ray.init(address=os.environ.get("RAY_ADDRESS", "auto"), **quiet)
            except ConnectionError:
                if "RAY_ADDRESS" in os.environ:
                    raise
                self._ray.init(include_dashboard=False, **quiet)
        except (ConnectionError, RuntimeError, ValueError) as error:
            what = os.environ.get("RAY_ADDRESS", "a cluster")
            raise RayError(f"--engine ray: {what} can't be reached: {str(error).splitlines()[0]}") from None

    def _run(self, tasks: Sequence[Task]) -> Iterator[Said]:
        judge = self._ray.remote(num_cpus=1, max_retries=0)(_judge)
        question, folder = self._ray.put(self._question), str(Path.cwd())
        count = self._count or max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        waiting, going = deque(tasks), dict[Any, tuple[Task, float]]()
        while waiting or going:
            while waiting and len(going) < count:
                task = waiting.popleft()
                going[judge.remote(question, folder, task)] = task, time.monotonic()
            ready, _ = self._ray.wait(list(going), num_returns=1, timeout=_LOOK_EVERY)
            for reference in ready:
                task, since = going.pop(reference)
                yield from self._result(reference, task, overdue=since == math.inf)
                yield Ended(task.place)
            self._end_overdue(going)

    def _result(self, reference: Any, task: Task, *, overdue: bool) -> Sequence[Unit]:
        try:
            found: list[Unit] = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            why = f"could not be judged on Ray: {type(error).__name__}: {str(error).strip().splitlines()[-1]}"
            if overdue:
                why = f"took longer than {self._timeout:g} s for each spec (--timeout)"
            return failed(self._question, task, task.specs, f"{task.path}: {why}")
        return found

    def _end_overdue(self, going: dict[Any, tuple[Task, float]]) -> None:
        """End what takes too long; its result is that it was."""
        if self._timeout is None:
            return
        for reference, (task, since) in list(going.items()):
            if time.monotonic() > since + self._timeout * len(task.specs):
                self._ray.cancel(reference, force=True)
                going[reference] = task, math.inf


@functools.lru_cache(maxsize=1)
def _judge_of(question: Question) -> Judge:
    return Judge(question)


def _judge(question: Question, folder: str, task: Task) -> list[Unit]:
    """On a machine of the cluster: all results of a recording."""
    with suppress(OSError):
        os.chdir(folder)  # paths may be relative
    judge = _judge_of(question)
    return [said for said in judge.judge(task, _show_nothing) if isinstance(said, Unit)]


def _show_nothing(part: float, events: int) -> None:
    """Ray tells who asked at the end only."""
    del part, events
