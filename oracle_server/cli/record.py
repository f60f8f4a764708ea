"""The command `record`: writes the trace of a session on a running server to a file."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import cast

from oracle_server.cli.client import Client, of_session
from oracle_server.core.episode import EpisodeRecord
from oracle_server.core.errors import TraceError
from oracle_server.core.spec import GAP
from oracle_server.core.units import counted
from oracle_server.foxglove.file import Beside, write_mcap
from oracle_server.process.progress import Show, progress


def record_session(client: Client, session: str, out: Path) -> None:
    """Write the trace of a session as MCAP or JSON Lines, by the suffix of `out`.

    Raises `ServerUnreachableError`, or `TraceError` where the file can't be written.
    """
    if out.suffix not in (".mcap", ".jsonl"):
        raise TraceError(f"{out}: name it .mcap or .jsonl")
    with progress(f"{session} to {out.name}", "lines") as show:
        lines = _told(client.lines(of_session(session, "trace")), show)
        count = _write(client, session, lines, out)
    sys.stdout.write(f"{out}: {counted(count, 'line')} of {session}\n")


def _told(lines: Iterable[bytes], show: Show) -> Iterator[bytes]:
    for count, line in enumerate(lines, start=1):
        show(count, None, count)
        yield line


def _write(client: Client, session: str, lines: Iterator[bytes], out: Path) -> int:
    part = out.with_name(out.name + ".part")
    try:
        part.touch()  # where that can't be, nothing is asked for
        if out.suffix == ".mcap":
            state, of = client.get(of_session(session)), of_session(session)
            beside = Beside(
                lambda: client.lines(f"{of}/changes"),
                lambda: cast("list[EpisodeRecord]", client.pages(f"{of}/episodes")),
                state.get("gap") or GAP,  # older servers do not tell
                state.get("status") == "closed",
            )
            count = write_mcap(part, lines, beside)
        else:
            with part.open("wb") as file:
                count = sum(1 for line in lines if file.write(line + b"\n"))
        part.replace(out)
    except OSError as error:
        raise TraceError(f"{out}: can't be written: {error.strerror}") from None
    finally:
        part.unlink(missing_ok=True)
    return count
