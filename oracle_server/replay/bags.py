"""ROS 1 bags, and ROS 2 bags in sqlite3 and MCAP, as recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from oracle_server.core.errors import TraceError, one_line
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.spec import Spec
from oracle_server.core.stamps import DEFAULT_PATHS, stamp_in
from oracle_server.replay.bagmessages import Read, message_reader
from oracle_server.replay.recording import Recorded
from oracle_server.wire.flat import find_stream

MONITOR = "replay"


class Bag:
    """The messages of a bag on a spec's topics, in the order in which they were recorded.

    A message counts as arrived when it was recorded. `read` and `size` count messages.
    """

    clocked = True

    def __init__(self, path: Path, spec: Spec, types: Sequence[Path] = ()) -> None:
        """Prepare to read a bag; `types` are folders with the .msg files of types that it does not define itself.

        Raises `TraceError` where these can't be read.
        """
        self.path = path
        self.ignored: Counter[str] = Counter()
        self.read = self.size = 0
        self._spec, self._types = spec, _typestore(types)
        self._fields = {key: stream.project.fields for key, stream in plan(spec).streams.items()}

    def __iter__(self) -> Iterator[Recorded]:
        """The messages. Raises `TraceError` where the bag can't be read."""
        try:
            with AnyReader([self.path], default_typestore=self._types) as reader:
                yield from self._messages(reader)
        except TraceError as error:
            raise TraceError(f"{self.path}: {error}") from None
        except GeneratorExit:
            raise
        except Exception as error:  # noqa: BLE001 -- the reader raises anything for a damaged bag
            raise TraceError(f"{self.path}: can't be read as a bag: {_reason(error)}") from None

    def _messages(self, reader: AnyReader) -> Iterator[Recorded]:
        connections, observed = [], {}
        for connection in reader.connections:
            key = find_stream(connection.topic, "topic", self._spec.by_key)
            if key is None:
                self.ignored[connection.topic] += connection.msgcount
            else:
                connections.append(connection)
                observed[connection.id] = (key, self._spec.by_key[key].stamp, self._reader(reader, connection, key))
        if not observed:
            return
        self.size = sum(connection.msgcount for connection in connections)
        now = 0
        for connection, recorded, raw in reader.messages(connections=connections):
            key, stamp, read = observed[connection.id]
            data = read(reader.deserialize(raw, connection.msgtype))
            self.read += 1
            now = max(now, recorded)
            yield Recorded(Event(key, MONITOR, self.read, stamp_in(data, stamp), now, data))

    def _reader(self, reader: AnyReader, connection: Any, key: StreamKey) -> Read:
        fields = self._fields[key]
        if fields is not None:
            stamp = self._spec.by_key[key].stamp
            fields = fields | frozenset([stamp] if stamp else DEFAULT_PATHS)
        return message_reader(reader.typestore, connection.msgtype, fields)


def _reason(error: Exception) -> str:
    return one_line(str(error).strip()) or type(error).__name__


def _typestore(folders: Sequence[Path]) -> Typestore:
    """The types of ROS 2's own packages, and those of the .msg files in folders, each in `PACKAGE/msg/`."""
    store = get_typestore(Stores.LATEST)
    for folder in folders:
        found = sorted(folder.rglob("*.msg"))
        if not found:
            raise TraceError(f"{folder}: has no .msg files")
        for path in found:
            package = (path.parent.parent if path.parent.name == "msg" else path.parent).name
            try:
                types = get_types_from_msg(path.read_text(encoding="utf-8"), f"{package}/msg/{path.stem}")
                store.register({name: t for name, t in types.items() if name not in store.fielddefs})
            except Exception as error:  # noqa: BLE001 -- the parser raises anything for a malformed file
                raise TraceError(f"{path}: can't be read as a message definition: {_reason(error)}") from None
    return store
