"""The command `replay … --on`: judges many recordings by the same specs, and keeps what they came to as a table."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import msgspec

from oracle_server.core.errors import OracleError, TraceError
from oracle_server.core.events import By
from oracle_server.core.units import counted
from oracle_server.process.progress import Show, progress
from oracle_server.replay.command import say
from oracle_server.replay.many.digest import extent, folders_digest
from oracle_server.replay.many.gather import Gathered, gather
from oracle_server.replay.many.judging import Question, Task, Text, Unit, path_text
from oracle_server.replay.many.results import Beside, Kept, Rows, Told
from oracle_server.replay.many.summary import Tally, named
from oracle_server.replay.many.tablefile import write_csv
from oracle_server.replay.many.workers import Ended, Progress, Said, Workers
from oracle_server.replay.opening import is_recording
from oracle_server.replay.preparing import doubtful, read_spec
from oracle_server.replay.report.formats import Format
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import SpecFile

EngineName = Literal["local", "ray"]
_NAMED = 20
"""Recordings that can't be used and are named on standard error; the table has all."""


class Engine(Protocol):
    """Judges recordings somewhere."""

    def run(self, tasks: Sequence[Task]) -> Iterator[Said]:
        """What is said of the recordings, in any order; all of it of one before its `Ended`."""
        ...


class Where(NamedTuple):
    """Where recordings are judged: by so many at once, None for as many as the engine has room for.

    `timeout` (ns) is how long one spec may take for one recording, 0 for ever.
    """

    engine: EngineName = "local"
    jobs: int | None = None
    timeout: int = 0


_HERE = Where()


def run_many(
    recordings: Sequence[Path],
    specs: Sequence[Path],
    by: By | None = None,
    form: Format = "text",
    types: Sequence[Path] = (),
    *,
    strict: bool = False,
    out: Path | None = None,
    where: Where = _HERE,
) -> int:
    """Judge recordings by specs, and write a table; returns the exit status, the gravest of all recordings.

    With `out` the table goes to a file, of which what is there by digest is kept; else to standard output, in a format.
    Raises `OracleError` where a spec or the file can't be used; of what is wrong with a recording its rows tell.
    """
    if form in ("junit", "github"):
        raise OracleError(f"--format {form} is for one recording: `replay SPEC… RECORDING`")
    if out is not None and form != "text":
        raise OracleError(f"--out {out}: its format is that of its name; leave out --format and --json")
    known = Types(types)
    loaded = [_load(path, known, by) for path in specs]
    for file in loaded:
        say(doubtful(file))
    _refuse_questions(loaded, where)
    question = Question(
        tuple(_text(path, file) for path, file in zip(specs, loaded, strict=True)),
        by,
        strict,
        tuple(folder.absolute() for folder in types),
        folders_digest(types),
    )
    engine = _engine(question, where)
    gathered = gather(recordings, Beside.of(out) if out is not None else ())
    tally = Tally(question.specs)
    results = _results(question, gathered.recordings, out, form, tally)
    with closing(results):
        try:
            _judge(engine, results, gathered.recordings, len(specs), tally)
        except KeyboardInterrupt:
            if out is not None:
                say([f"ended; what was judged is kept in {Beside.of(out).journal}, and the same command goes on"])
            raise
        others = results.finish()
    _conclude(gathered, tally, out, form)
    if out is not None and others:
        say([f"{counted(others, 'result')} in {out} that this does not ask for, now in {Beside.of(out).old}"])
    return tally.status


def _load(path: Path, types: Types, by: By | None) -> SpecFile:
    if is_recording(path):
        raise TraceError(f"{path}: is a recording, and stands where a spec is expected: `replay RECORDING… --on SPEC…`")
    return read_spec(path, types, by)


def _text(path: Path, file: SpecFile) -> Text:
    digest = hashlib.sha256(file.text.encode()).hexdigest()
    return Text(path_text(path), file.text, digest, file.spec.id, tuple(prop.id for prop in file.spec.properties))


def _refuse_questions(loaded: Sequence[SpecFile], where: Where) -> None:
    """Refuse to ask an oracle elsewhere about several recordings at once, which it may take for one."""
    for file in loaded:
        asking = [prop.id for prop in file.spec.properties if prop.external is not None]
        if asking and (where.engine != "local" or (where.jobs or 1) > 1):
            raise OracleError(
                f"{file.spec.id}: the oracle of {asking[0]} is asked about one recording at a time: leave out "
                + ("-j" if where.engine == "local" else "--engine")
            )


def _engine(question: Question, where: Where) -> Engine:
    timeout = where.timeout / 10**9 or None
    if where.engine == "ray":
        from oracle_server.replay.many.onray import RayCluster

        return RayCluster(question, where.jobs, timeout)
    return Workers(question, where.jobs or 1, timeout)


def _results(
    question: Question, recordings: Sequence[Path], out: Path | None, form: Format, tally: Tally
) -> Kept | Told:
    if out is not None:
        return Kept(Beside.of(out), question, recordings)
    return Told(_teller(form, tally), len(question.specs))


def _teller(form: Format, tally: Tally) -> Callable[[Rows], None]:
    """What writes rows to standard output."""
    if form == "csv":
        write_csv((), sys.stdout)
        return lambda rows: write_csv(rows, sys.stdout, headed=False)
    if form == "jsonl":
        return lambda rows: sys.stdout.writelines(msgspec.json.encode(row).decode() + "\n" for row in rows)
    return lambda rows: sys.stdout.writelines(f"{line}\n" for line in tally.lines(rows))


def _judge(engine: Engine, results: Kept | Told, recordings: Sequence[Path], specs: int, tally: Tally) -> None:
    sizes = [_size(path) for path in recordings]
    tasks = [
        Task(i, path, tuple(range(specs)), results.known(path, size))
        for i, (path, size) in enumerate(zip(recordings, sizes, strict=True))
    ]
    with progress("recordings", "events", after=0) as show:
        course = _Course(show, sizes)
        for said in engine.run(tasks):
            if isinstance(said, Unit):
                tally.add(said.spec, results.take(said))
            course.note(said)


def _size(path: Path) -> int:
    try:
        return extent(path).size
    except TraceError:
        return 0


class _Course:
    """How far all recordings are, by their bytes."""

    def __init__(self, show: Show, sizes: Sequence[int]) -> None:
        self._show = show
        self._sizes = [size + 1 for size in sizes]
        self._total = sum(self._sizes)
        self._parts: dict[int, float] = {}
        """Of the recordings that are being judged."""
        self._ended = self._bytes = self._events = 0

    def note(self, said: Said) -> None:
        if isinstance(said, Progress):
            self._parts[said.task] = said.part
            self._events += said.events
        elif isinstance(said, Ended):
            self._parts.pop(said.task, None)
            self._ended += 1
            self._bytes += self._sizes[said.task]
        going = sum(part * self._sizes[task] for task, part in self._parts.items())
        what = f"{self._ended} of {counted(len(self._sizes), 'recording')}"
        self._show(self._bytes + going, self._total, self._events, what)


def _conclude(gathered: Gathered, tally: Tally, out: Path | None, form: Format) -> None:
    if out is not None or form == "text":
        tally.write(sys.stdout)
    sys.stdout.flush()
    names = filter(tally.broken.__contains__, map(path_text, gathered.recordings))
    broken = [named(name, tally.broken[name]) for name in names]
    lines = broken[:_NAMED] if out is not None or form != "text" else []
    if len(lines) < len(broken) and lines:
        lines.append(
            f"{counted(len(broken) - len(lines), 'more recording')} can't be used; the column `error` says why"
        )
    if gathered.others:
        lines.append(f"{counted(gathered.others, 'file')} in the folders passed over: no recordings")
    lines += [f"{link}: is a folder by a link, and passed over: name it, too" for link in gathered.links]
    say(lines)
