"""ROS 1 bags, and ROS 2 bags in sqlite3 and MCAP, as recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from oracle_server.core.errors import NotReadError, TraceError, one_line
from oracle_server.core.events import Event
from oracle_server.core.plan import plan
from oracle_server.core.spec import Spec
from oracle_server.process.openfiles import allow
from oracle_server.replay.bags.actionroles import add_actions
from oracle_server.replay.bags.actions import Action, ActionSource
from oracle_server.replay.bags.notes import notes_of, of_channels, of_times
from oracle_server.replay.bags.passing import Filter
from oracle_server.replay.bags.published import Published
from oracle_server.replay.bags.roles import roles
from oracle_server.replay.bags.sources import Item, Source, Topic
from oracle_server.replay.doubts.pauses import Pauses
from oracle_server.replay.files.folder import Files, files_of, open_storage
from oracle_server.replay.files.packed import HEAD, is_packed, unpack
from oracle_server.replay.files.scratch import NoRoomError, let_go, unpacking
from oracle_server.replay.files.storage import LATEST, Channel, Missing, Storage
from oracle_server.replay.files.together import together
from oracle_server.replay.recording import Note, Recorded
from oracle_server.replay.traces.times import notes_of_span
from oracle_server.rostypes.bagtypes import typestore

MONITOR = "replay"
_OTHER_FILES = 100
"""Files that are open beside those of a bag."""


_AnySource = Source | ActionSource


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
        self.passed_over: Container[int] = ()
        self.notes: list[Note] = []
        self.read = self.size = self.since = self.until = self.lost = 0
        self._plan, self._types = plan(spec), typestore(types)
        self._published = Published(spec.ordering.max_skew, spec.ordering.max_delay)
        self._pauses = Pauses()
        self._topics: dict[str, Topic] = {}
        self._actions: dict[str, Action] = {}
        self._sources: dict[Channel, _AnySource] = {}
        """By channels without their numbers: a topic has one for each publisher, or in each file."""

    def __iter__(self) -> Iterator[Recorded]:
        """The messages. Raises `TraceError` where nothing of the bag can be read."""
        place = self.path
        try:
            with ExitStack() as stack:
                place = _unpacked(self.path, stack)
                files = files_of(place)
                storages = self._open(files, stack)
                if place != self.path:
                    let_go(place)
                sources = self._prepare(files, storages)
                self._survey(storages, sources)
                self.since = self._published.since = _oldest(storages)
                yield from self._events(storages, sources)
                self.until = _newest(storages)
                self.notes += [*notes_of(self._topics.values(), files, storages), *self._published.notes()]
                self.notes += of_times(self._topics.values()) if self.since else ()
                self.notes += notes_of_span(self.since, self.until)
                self.notes += self._pauses.standing(self._plan.spec)
                self.notes += (Note(text, doubt=True) for text in self._pauses.told(partial(_heard, storages)))
        except TraceError as error:
            text = one_line(str(error).replace(f"{place}", str(self.path)))
            raise TraceError(text if text.startswith(str(self.path)) else f"{self.path}: {text}") from None
        except NoRoomError as error:
            raise NoRoomError(one_line(str(error).replace(f"{place}", str(self.path)))) from None
        except OSError as error:
            raise NotReadError(f"{self.path}: can't be read: {error.strerror or error}") from None

    def _open(self, files: Files, stack: ExitStack) -> list[Storage]:
        found, failed = list[tuple[Path, Storage]](), []
        allow(len(files.paths) + _OTHER_FILES)
        for path in files.paths:
            if files.missing and not path.is_file():
                found.append((path, Missing(files.missing)))
                continue
            try:
                found.append((path, open_storage(path, stack)))
            except TraceError as error:
                failed.append(error)
                found.append((path, Missing(str(error).removeprefix(f"{path}: "))))
        if all(isinstance(storage, Missing) for _, storage in found):
            raise failed[0]
        files.paths = [path for path, _ in found]
        return [storage for _, storage in found]

    def _prepare(self, files: Files, storages: Sequence[Storage]) -> list[dict[int, _AnySource]]:
        """The sources of each file by channel; what else is in the bag is ignored, and its types do not matter."""
        there = _there(files, storages)
        found = roles(there, self._plan.spec)
        add_actions(found, there, self._plan.spec)
        self.notes += found.notes
        for name, role in found.by_topic.items():
            self._topics[name] = topic = Topic(name, role)
            if role.forwarded is not None:
                within = self._plan.spec.by_key[role.streams[0]].decide_within
                topic.asked = Filter(within)
                self._topics[role.forwarded] = Topic(role.forwarded, None, gives=topic.asked)
        self.ignored += Counter({name: count for name, count in there.items() if name not in self._topics})
        self.size = sum(there[name] for name, topic in self._topics.items() if topic.role is not None)
        for name, topic in self._topics.items():
            topic.promised = there[name]
        for name, role in found.by_topic.items():
            for topic_name in (name, role.forwarded):
                if topic_name is not None:
                    type_ = role.type if role.action else self._plan.spec.by_key[role.streams[0]].type
                    self._topics[topic_name].wanted = type_
        return self._sources_of(storages)

    def _sources_of(self, storages: Sequence[Storage]) -> list[dict[int, _AnySource]]:
        """The sources of each file by channel. Raises `TraceError` where no channel can be read."""
        sources = [
            {c.id: source for c in _channels(storage) if (source := self._source(c)) is not None}
            for storage in storages
        ]
        refused = next((topic.refused for topic in self._topics.values() if topic.refused), "")
        if refused and not any(sources):
            raise TraceError(refused)
        for topic in self._topics.values():
            self.notes += of_channels(topic)
        return sources

    def _source(self, channel: Channel) -> _AnySource | None:
        if channel.topic not in self._topics:
            return None
        topic = self._topics[channel.topic]
        if not topic.takes(channel):
            topic.leave_out(channel)
            return None
        alike = channel._replace(id=0, promised=None)
        try:
            if alike not in self._sources:
                self._sources[alike] = self._new_source(channel, topic)
            return self._sources[alike]
        except TraceError as error:
            why = str(error)
        except Exception as error:  # noqa: BLE001 -- a damaged definition makes the library raise anything
            why = f"{channel.topic}: its messages can't be read as {channel.type}: {_reason(error)}"
        if channel.promised != 0:
            topic.refused = topic.refused or why
            topic.leave_out(channel)
        return None

    def _new_source(self, channel: Channel, topic: Topic) -> _AnySource:
        if topic.role is not None and topic.role.action:
            action = self._actions.setdefault(topic.role.action, Action())
            return ActionSource(channel, topic, self._plan, self._types, action)
        return Source(channel, topic, self._plan, self._types)

    def _survey(self, storages: Sequence[Storage], sources: Sequence[dict[int, _AnySource]]) -> None:
        """Look at what must be known as a whole before the first event: whose side is recorded, and what passed."""
        self._look(storages, [{n: s for n, s in own.items() if s.topic.surveyed} for own in sources], _survey)
        filtered = [
            {n: s for n, s in own.items() if s.topic.is_service and (s.topic.asked or s.topic.gives)} for own in sources
        ]
        self._look(storages, filtered, _survey_calls)
        for topic in self._topics.values():
            topic.calls = None  # which begin anew
            if topic.asked is not None:
                topic.asked.settle()

    def _look(
        self,
        storages: Sequence[Storage],
        sources: Sequence[dict[int, _AnySource]],
        look: Callable[[_AnySource, int, bytes], None],
    ) -> None:
        for source, time, raw, _ in together(storages, sources, lambda: None):
            try:
                look(source, time, raw)
            except Exception:  # noqa: BLE001 -- it is told of when it is read
                source.topic.note_unseen(time)

    def _events(self, storages: Sequence[Storage], sources: Sequence[dict[int, _AnySource]]) -> Iterator[Recorded]:
        now = seq = 0
        wanted = [{n: s for n, s in own.items() if s.topic.role is not None} for own in sources]
        for source, recorded, raw, told in together(storages, wanted, self._note_gap):
            self.read += 1
            time = recorded or self.since  # it is none: recorders in a simulation write it until they hear its clock
            self._pauses.look(time)
            source.topic.timed += recorded > 0
            try:
                items = self._items(source, time, raw, told)
            except Exception as error:  # noqa: BLE001 -- decoding raises anything for damaged messages
                source.topic.note_unreadable(_reason(error))
                self._note_gap()
                continue
            for item in items:
                seq, now = seq + 1, max(now, time)
                self._pauses.published(item.stamp)
                yield Recorded(_event(item, seq, now, self.lost), passed=item.passed)
                self.lost = 0

    def _note_gap(self) -> None:
        self.lost += 1

    def _items(self, source: _AnySource, time: int, raw: bytes, told: int) -> list[Item]:
        source.topic.seen += 1
        found = source.items(raw, partial(self._published.of, source.topic.name, time, told))
        if not source.lasts:
            return found
        return [item._replace(stamp=self._published.heard(item.stamp, time)) for item in found]


def _unpacked(path: Path, stack: ExitStack) -> Path:
    """Where the bag is: at its path, or in a folder of its own, until `stack` is closed, where it was packed."""
    if path.is_dir():
        return path
    with path.open("rb") as file:
        packed = is_packed(file.read(HEAD))
    if not packed:
        return path
    folder = stack.enter_context(unpacking(path))
    unpack(path, folder)
    return folder


def _there(files: Files, storages: Sequence[Storage]) -> Counter[str]:
    """The topics of a bag, each with as many messages as the files have, or as its metadata promises."""
    there, promised = Counter[str](), Counter[str]()
    for storage in storages:
        for channel in _channels(storage):
            there[channel.topic] += channel.promised or 0
    for name, count in (files.promised or {}).items():
        promised[_rooted(name)] += count
    for name, count in promised.items():
        there[name] = max(there[name], count)
    return there


def _channels(storage: Storage) -> Iterator[Channel]:
    """The channels of a file, with the names of topics that ROS gives them."""
    return (channel._replace(topic=_rooted(channel.topic)) for channel in storage.channels)


def _rooted(topic: str) -> str:
    """A topic's name with its slash, which some programs leave out: a bag may have the same topic by both names."""
    return f"/{topic.strip('/')}"


def _oldest(storages: Sequence[Storage]) -> int:
    """When the first message of a bag was recorded, on whatever topic; 0 where that is not known."""
    return min((storage.oldest for storage in storages if 0 < storage.oldest <= LATEST), default=0)


def _newest(storages: Sequence[Storage]) -> int:
    """When the last message of a bag was recorded, on whatever topic; 0 where that is not known."""
    return max((newest for newest in (storage.newest for storage in storages) if newest <= LATEST), default=0)


def _heard(storages: Sequence[Storage], since: int, until: int) -> bool:
    """Whether a bag has a message that was recorded between two times (ns), on whatever topic."""
    return any(storage.has_between(since, until) for storage in storages)


def _survey(source: _AnySource, time: int, raw: bytes) -> None:
    source.survey(time, raw)


def _survey_calls(source: _AnySource, time: int, raw: bytes) -> None:
    if isinstance(source, Source):
        source.survey_calls(time, raw)


def _event(item: Item, seq: int, now: int, lost: int) -> Event:
    return Event(
        item.stream, MONITOR, seq, item.stamp, now, item.data, call=item.call, lost=lost, ask=item.asks,
        goal_id=item.goal_id, status=item.status,
    )  # fmt: skip


def _reason(error: Exception) -> str:
    return one_line(str(error).strip()) or type(error).__name__
