"""`replay --serve`: a recording in the dashboard of a server of its own, of which nothing is left in the end."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx

from oracle_server.core.errors import TraceError, one_line
from oracle_server.core.units import counted
from oracle_server.process.daemon import LOG as SERVER_LOG
from oracle_server.process.daemon import launch
from oracle_server.process.pidfile import running
from oracle_server.process.progress import progress
from oracle_server.replay.conclusion import gravest
from oracle_server.replay.files.folder import MAGICS, METADATA, begins_as
from oracle_server.replay.files.sqlitefile import LOG, log_of
from oracle_server.replay.opening import refuse_swapped
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import SpecFile, load_spec

_STARTED_WITHIN = _STOPPED_WITHIN = 60.0
_ASK_EVERY = 0.1
"""Seconds between two questions of how far a recording has got."""
_PIECE = 2**20


def show_recording(specs: Sequence[Path], trace: Path, types: Sequence[Path]) -> int:
    """Judge a recording by each spec on a server of its own, and let it be looked at until Ctrl-C.

    Returns the exit status of `replay`. Raises `SpecError` and `TraceError` where an input can't be used.
    """
    refuse_swapped(specs, trace)
    known = Types(types)
    loaded = {each.spec.id: each for each in (load_spec(path, types=known) for path in specs)}
    with contextlib.suppress(KeyboardInterrupt), tempfile.TemporaryDirectory() as place:
        statuses: list[int] = []
        file = _as_one(trace, Path(place) / "packed")
        with _server(Path(place), file, loaded, types) as (process, url):
            try:
                with httpx.Client(base_url=url, trust_env=False, timeout=_STARTED_WITHIN) as http:
                    statuses += [_judged(http, file, name) for name in loaded]
            except httpx.HTTPError as error:
                raise TraceError(f"the server that is to show it does not answer: {error}") from None
            with contextlib.suppress(KeyboardInterrupt):  # which may come as soon as it is told
                sys.stdout.write("Ctrl-C ends it; nothing of it is kept\n")
                sys.stdout.flush()
                process.wait()
                raise TraceError("the server that shows it has ended by itself")
        return gravest(statuses)
    return 130


def _as_one(trace: Path, place: Path) -> Path:
    """What is sent of a recording: its file, or a new one in `place` where it has several. Raises `TraceError`."""
    try:
        if not trace.is_dir():
            log = log_of(trace)
            if log is None:
                return trace
            files = [trace, log]
        else:
            files = sorted(path for path in trace.iterdir() if path.is_file() and _of_bag(path))
        place.mkdir()
        packed = place / (trace.resolve().name or "recording")
        with tarfile.open(packed, "w", dereference=True) as archive:
            for path in files:
                archive.add(path, path.name)
    except OSError as error:
        raise TraceError(f"{trace}: can't be packed to be shown: {error.strerror or error}") from None
    return packed


def _of_bag(path: Path) -> bool:
    return path.name == METADATA or path.name.endswith(LOG) or begins_as(path) in MAGICS


@contextlib.contextmanager
def _server(
    place: Path, recording: Path, specs: dict[str, SpecFile], types: Sequence[Path]
) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """A server with these specs on a free port, and its address; all that it writes is in `place`."""
    folder, data = place / "specs", place / "data"
    folder.mkdir()
    for name, file in specs.items():
        (folder / f"{name}.yaml").write_text(file.text, encoding="utf-8")
    plain = {name: value for name, value in os.environ.items() if not name.startswith("ORACLE_")}
    settings = {
        "ORACLE_PORT": "0",
        "ORACLE_SPECS": str(folder),
        "ORACLE_DATA_DIR": str(data),
        "ORACLE_TYPES": os.pathsep.join(str(path.absolute()) for path in types),
        "ORACLE_DURABILITY": "normal",
        "ORACLE_MAX_RECORDING": f"{_size(recording) // 1000 + 1}kB",
    }
    process, _ = launch(plain | settings, data / SERVER_LOG, _STARTED_WITHIN, keep=False)
    try:
        started = running(data)
        if started is None or started.url is None:
            raise TraceError("the server that is to show it has ended at once")
        yield process, started.url
    finally:
        process.terminate()
        try:
            process.wait(_STOPPED_WITHIN)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _size(recording: Path) -> int:
    try:
        return recording.stat().st_size
    except OSError as error:
        raise TraceError(f"{recording}: can't be read: {error.strerror}") from None


def _judged(http: httpx.Client, recording: Path, spec: str) -> int:
    """Have a recording judged by a spec, and print where it is to be seen; returns the exit status of `replay`."""
    one = _sent(http, recording, spec)
    with progress(recording.name, "events", after=0) as show:
        while one["state"] in ("queued", "judging"):
            show(one["read"], one["total"] or None, one["events"])
            time.sleep(_ASK_EVERY)
            one = http.get(f"/api/v1/recordings/{one['id']}").json()
    if one["exit"] is None:
        raise TraceError(one["error"] or f"{recording}: was not judged to its end")
    state = http.get(f"/api/v1/sessions/{spec}").json()
    violations = sum(row["violations"] for row in state["properties"])
    counts = f"{counted(one['events'], 'event')}, {counted(violations, 'violation')}"
    sys.stdout.write(f"{str(http.base_url).rstrip('/')}/#/sessions/{spec}: {counts}\n")
    sys.stdout.writelines(f"{one_line(note)}\n" for note in one["notes"])
    return int(one["exit"])


def _sent(http: httpx.Client, recording: Path, spec: str) -> dict[str, Any]:
    """Send a recording; returns what the server says of it."""
    query = {"spec": spec, "session": spec, "name": recording.name}
    try:
        with recording.open("rb") as file:
            pieces = iter(lambda: file.read(_PIECE), b"")
            answer = http.post("/api/v1/recordings", params=query, content=pieces)
    except OSError as error:
        raise TraceError(f"{recording}: can't be read: {error.strerror}") from None
    found: dict[str, Any] = answer.json()
    if answer.is_error:
        raise TraceError(f"{recording}: {found.get('detail', answer.reason_phrase)}")
    return found
