"""What a session's timeline costs: its blocks, beside the rows that are written anyway, and questions of any width.

python benchmarks/timeline.py [--rows 1000000] [--folder /tmp]

The rows are those of a battery's UAV: 80 a second on six streams, six properties, one in 1,000 late. *Blocks* is the
writer's time with them to that without, in the same run.
"""

from __future__ import annotations

import argparse
import math
import random
import sqlite3
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path
from statistics import median

from oracle_server.history.columns import PARTS, Part
from oracle_server.history.records import SessionRecord
from oracle_server.history.sql.batch import Work, insert_rows, write
from oracle_server.history.sql.blocks import BlockWriter
from oracle_server.history.sql.rows import Row
from oracle_server.history.sql.timeline import asked
from oracle_server.history.sqlite.history import NAME, SqliteHistory
from oracle_server.history.sqlite.migrations import migrate
from oracle_server.history.timeline import Question

BASE = 1_732_147_200 * 10**9
STREAMS = (("/battery_percentage", "topic"), ("/input_accepted", "topic"), ("/battery_status", "topic"),
    ("/LED_panel", "topic"), ("/SetLED", "request"), ("/SetLED", "response"))  # fmt: skip
WEIGHTS = (25, 10, 10, 33, 1, 1)
COMMIT = 40
"""Rows a commit: what comes within 0.5 s."""
COMPARED = 200_000
"""Rows that are also written without blocks."""
OPEN = (
    "INSERT INTO sessions (number, id, spec, text, digest, properties, private, opened) "
    'VALUES (1, \'long\', \'uav\', \'id: uav\', \'digest\', \'["a","b","c","d","e","f"]\', 0, 0)'
)
WHY = '{"2":{"text":"c does not hold at step 394","formula":"once {topic: \\"/a\\"}","event":{"signals":{"id":"51"}}}}'


def filled(folder: Path, count: int) -> None:
    """Make a history in a folder, of one open session with so many steps and nothing else."""
    SqliteHistory(folder).close()
    with closing(sqlite3.connect(folder / NAME, isolation_level=None)) as database:
        database.execute("BEGIN")
        database.execute(OPEN)
        insert_rows(database, "steps", [*rows(count)])
        database.execute("COMMIT")


def rows(count: int) -> Iterator[Row]:
    """Rows of the history's table of steps."""
    rng = random.Random(1)
    for position, (stream, kind) in enumerate(rng.choices(STREAMS, WEIGHTS, k=count), 1):
        at = BASE + position * 12_500_000
        late = position % 1000 == 0
        asked = kind == "request"
        signals = f'{{"id":"{position // 8}","percentage":{position % 100}}}'
        if stream == "/battery_status":
            signals = f'{{"id":"{position // 8}","status":"{position // 999 % 3}","status_change":false}}'
        wrong = position % 5000 < 3
        choice = "deny" if wrong else "allow"
        yield (
            1, position, "publication", position, stream, kind, "uav1", position, 0, at - late * 300_000_000,
            at + 800_000, at + 9_000_000, int(late), 0, 0, int(position % 10_000 == 0), "/battery", None, int(asked),
            choice if asked else None, "[]", None, None, signals, "[]", "ttfttu" if wrong else "tttttt", "000000",
            WHY if wrong else None, None, "frontier", *(None,) * 8,
        )  # fmt: skip


class Written:
    """A history with blocks or without, and the processor's time (s) that its rows took."""

    def __init__(self, path: Path, *, blocks: bool) -> None:
        path.parent.mkdir(exist_ok=True)
        self._database = sqlite3.connect(path, isolation_level=None)
        self._database.execute("PRAGMA journal_mode = WAL")
        self._database.execute("PRAGMA synchronous = OFF")
        migrate(self._database)
        self._database.execute(OPEN)
        self._blocks = BlockWriter() if blocks else None
        self.took = 0.0

    def add(self, made: Sequence[Row]) -> None:
        begin = time.process_time()
        for start in range(0, len(made), COMMIT):
            work = [Work(1, "steps", made[start : start + COMMIT])]
            self._database.execute("BEGIN IMMEDIATE")
            write(self._database, work)
            if self._blocks is not None:
                self._blocks.follow(self._database, work)
            self._database.execute("COMMIT")
        self.took += time.process_time() - begin

    def close(self) -> None:
        self._database.close()


def fill(path: Path, count: int) -> None:
    """Write so many rows with blocks, and for a while also without; print what blocks cost."""
    ours, bare = Written(path, blocks=True), Written(path.with_name("bare.sqlite"), blocks=False)
    made, written = rows(count), 0
    while batch := [*islice(made, 10_000)]:
        ours.add(batch)
        written += len(batch)
        if written <= COMPARED:
            bare.add(batch)
            if written in (COMPARED, count):
                more = (ours.took - bare.took) / written
                print(
                    f"blocks: {ours.took / bare.took:.2f} times the rows alone: {more * 1e6:.2f} µs a row "
                    f"beside {bare.took / written * 1e6:.2f}"
                )
    ours.close()
    bare.close()
    bare_size = path.with_name("bare.sqlite").stat().st_size / min(written, COMPARED)
    print(f"{path.stat().st_size / written - bare_size:.1f} bytes a row beside {bare_size:.0f}")
    path.with_name("bare.sqlite").unlink()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    options = parser.parse_args()
    path = options.folder / f"history-{options.rows}" / "history.sqlite"
    if not path.exists():
        fill(path, options.rows)
    questions(path, options.rows)


def questions(path: Path, count: int) -> None:
    """Ask for windows of several widths, about all of the middle."""
    session = SessionRecord(1, "long", "uav", "", "", tuple("abcdef"), private=False, opened=0)
    for share in (1.0, 0.01, 0.0001):
        long = int(count * 12_500_000 * share)
        since = BASE if share == 1 else BASE + int(count * 12_500_000 * 0.47)
        for name, parts, signals in (
            ("lanes", frozenset[Part](["lanes"]), ()),
            ("all", frozenset(PARTS), ("/battery_percentage:percentage",)),
        ):
            question = Question(since, since + long, 1000, parts, signals)
            times = []
            for _ in range(6):
                begin = time.perf_counter()
                with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True, isolation_level=None)) as reader:
                    size = len(asked(reader, session, question))
                times.append((time.perf_counter() - begin) * 1000)
            bare = rows_alone(path, since, long, count) if share < 1 or count <= COMPARED * 10 else math.nan
            print(
                f"{share:7.2%} {name:5}: {median(times[1:]):7.1f} ms, at first {times[0]:7.1f}; {size / 1000:.0f} kB; "
                f"{median(times[1:]) / bare:.3f} of reading its rows"
            )


def rows_alone(path: Path, since: int, long: int, count: int) -> float:
    """The ms to read the outcomes of a window's rows by a statement."""
    first = (since - BASE) // 12_500_000
    sql = "SELECT stamp, outcomes, degraded FROM steps WHERE session = 1 AND position BETWEEN ? AND ?"
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as reader:
        begin = time.perf_counter()
        reader.execute(sql, (first, min(count, first + long // 12_500_000))).fetchall()
        return (time.perf_counter() - begin) * 1000


if __name__ == "__main__":
    main()
