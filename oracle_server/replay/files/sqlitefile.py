"""The sqlite3 files of ROS 2 bags, of every version of their tables."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from urllib.parse import quote

from oracle_server.core.errors import TraceError
from oracle_server.replay.files.scratch import NoRoomError, let_go, unpacking, write
from oracle_server.replay.files.storage import LARGEST, Channel, Message, is_lasting

MAGIC = b"SQLite format 3\x00"
LOG = "-wal"
"""What follows a database's name in that of the file with what was committed, and is not in the database yet."""
_NO_ROOM = frozenset({sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_WRITE})
"""What sqlite says where it can't write what it sorts."""
_TOPICS = frozenset({"id", "name", "type"})
_STORED = frozenset({"id", "topic_id", "timestamp", "data"})
_DEFINITIONS = frozenset({"topic_type", "encoded_message_definition", "encoding"})
_MESSAGES = "SELECT topic_id, timestamp, data, id FROM messages"


class SqliteFile:
    """The channels and messages of an sqlite3 file."""

    def __init__(self, path: Path) -> None:
        """Find the channels. Raises `TraceError` where they can't be read, and OSError."""
        self.path = path
        self.damages: list[str] = []
        self._ended_early = False
        self._whole = _has_its_pages(path)
        if not self._whole:
            self.damages.append("ends early: pages of the database are missing")
        self._stack = ExitStack()
        try:
            self._database = self._open()
            self.channels = self._find_channels()
            self.described = self._find_described()
        except (sqlite3.Error, UnicodeDecodeError) as error:
            self._stack.close()
            raise TraceError(f"{path}: can't be read as a bag in sqlite3: {error}") from None
        except BaseException:
            self._stack.close()
            raise

    def _open(self) -> sqlite3.Connection:
        """Open the file, with what was committed but not written to it yet."""
        log = log_of(self.path)
        database = None if log is None else self._with_log(log)
        if database is None:
            database = self._connected(self.path, "mode=ro&immutable=1")
        database.text_factory = lambda data: data.decode(errors="replace")
        return database

    def _with_log(self, log: Path) -> sqlite3.Connection | None:
        """The database of copies, as sqlite writes beside what it opens with a log; None where that can't be read."""
        folder = self._stack.enter_context(unpacking(self.path))
        copies = folder / "bag.db3", folder / f"bag.db3{LOG}"
        for source, copy in zip((self.path, log), copies, strict=True):
            with source.open("rb") as file:
                write(file, copy, self.path)
        database = self._connected(copies[0], "mode=ro")
        try:
            database.execute("SELECT count(*) FROM sqlite_master").fetchone()
        except sqlite3.Error:
            self.damages.append(f"what {log.name} has can't be read")
            return None
        let_go(folder)
        return database

    def _connected(self, path: Path, how: str) -> sqlite3.Connection:
        database = sqlite3.connect(f"file:{quote(os.fsencode(path.absolute()))}?{how}", uri=True)
        self._stack.callback(database.close)
        return database

    def _find_channels(self) -> list[Channel]:
        columns = self._columns("topics")
        if not (columns >= _TOPICS and self._columns("messages") >= _STORED):
            raise sqlite3.DatabaseError("it has no table of topics, or none of messages")
        definitions: dict[str, tuple[str, str]] = {}
        if self._columns("message_definitions") >= _DEFINITIONS:
            query = "SELECT topic_type, encoded_message_definition, encoding FROM message_definitions"
            definitions = {str(row[0]): (str(row[1]), str(row[2])) for row in self._database.execute(query)}
        counts = self._counts()
        form = "serialization_format" if "serialization_format" in columns else "'cdr'"
        offered = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
        found = []
        query = f"SELECT id, name, type, {form}, {offered} FROM topics"  # noqa: S608
        for number, topic, kind, serialization, qos in self._database.execute(query):
            text, encoding = definitions.get(kind) or definitions.get(str(kind).removesuffix("_Event")) or ("", "")
            promised = None if counts is None else counts.get(number, 0)
            lasts = is_lasting(str(qos))
            found.append(Channel(number, str(topic), str(kind), text, encoding, str(serialization), promised, lasts))
        nameless = sorted(str(number) for number in (counts or {}).keys() - {channel.id for channel in found})
        if nameless:
            self.damages.append(f"has messages of topics that it does not name: {', '.join(nameless[:5])}")
        return found

    def _find_described(self) -> list[str]:
        if "metadata" not in self._columns("metadata"):
            return []
        query = f"SELECT metadata FROM metadata WHERE length(metadata) <= {LARGEST} LIMIT 100"  # noqa: S608
        return [str(text) for (text,) in self._database.execute(query)]

    def _columns(self, table: str) -> set[str]:
        """The columns that a table stores: no recorder has others, and what computes them may never come to an end."""
        is_stored = "SELECT 1 FROM sqlite_master WHERE type = 'table' AND rootpage > 0 AND name = ?"
        if self._database.execute(is_stored, (table,)).fetchone() is None:
            return set()
        return {row[1] for row in self._database.execute(f"PRAGMA table_info({table})")}

    def _counts(self) -> dict[int, int] | None:
        try:
            return dict(self._database.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"))
        except sqlite3.Error:
            return None  # reading the messages comes upon it again, and says so

    def messages(self, wanted: Collection[int]) -> Iterator[Message]:
        """The messages of these channels, by the time of recording; as they stand in a file that ends early.

        Raises `NoRoomError` where they are many, have no index, and the disk does not take them.
        """
        which = f"topic_id IN ({','.join('?' * len(wanted))})"
        query = f"{_MESSAGES} WHERE {which} ORDER BY timestamp, id"
        if not self._whole:
            query = f"{_MESSAGES} NOT INDEXED WHERE {which} ORDER BY id"
        try:
            for number, time, data, place in self._database.execute(query, tuple(wanted)):
                if not isinstance(time, int) or not isinstance(data, bytes):
                    self.damages.append("has a message that can't be read")
                    continue
                yield number, time, data, 0, place
        except sqlite3.Error as error:
            if getattr(error, "sqlite_errorcode", None) in _NO_ROOM:
                what = "can't be put in order in the folder for temporary files (TMPDIR)"
                raise NoRoomError(f"{self.path}: {what}: {error}") from None
            if self._whole:
                self._ended_early = True
                self.damages.append(f"ends early: {error}")

    @property
    def oldest(self) -> int:
        """The time of the first message that can be read."""
        return min(self._times("min"), default=0)

    @property
    def newest(self) -> int:
        """The time of the last message that can be read; 0 where reading them came to an end before that."""
        return 0 if self._ended_early else max(self._times("max"), default=0)

    def _times(self, which: str) -> Iterator[int]:
        """The first or the last time of recording (`min`, `max`); of a file that ends early all that can be read."""
        sound = "typeof(timestamp) = 'integer' AND timestamp > 0"
        query = f"SELECT {which}(timestamp) FROM messages WHERE {sound}"  # noqa: S608
        if not self._whole:
            query = f"SELECT timestamp FROM messages NOT INDEXED WHERE {sound} ORDER BY id"  # noqa: S608
        with suppress(sqlite3.Error):
            for (time,) in self._database.execute(query):
                if time:
                    yield time

    def has_between(self, since: int, until: int) -> bool:
        """Whether a message that can be read was recorded between two times (ns)."""
        query = "SELECT 1 FROM messages WHERE timestamp > ? AND timestamp < ? LIMIT 1"
        with suppress(sqlite3.Error):
            return self._database.execute(query, (since, until)).fetchone() is not None
        return False

    def close(self) -> None:
        """Close the file."""
        self._stack.close()


def log_of(path: Path) -> Path | None:
    """The file beside a database that has what is not in it yet, as where its recorder was killed. Raises OSError."""
    log = path.with_name(path.name + LOG)
    return log if log.is_file() and log.stat().st_size > 0 else None


def _has_its_pages(path: Path) -> bool:
    """Whether a database file is as long as its heading says."""
    with path.open("rb") as file:
        head = file.read(100)
    if len(head) < 100:
        return False
    size = int.from_bytes(head[16:18], "big")
    pages, changed, valid_for = (int.from_bytes(head[a : a + 4], "big") for a in (28, 24, 92))
    return changed != valid_for or path.stat().st_size >= pages * (2**16 if size == 1 else size)
