"""What is to be said of a bag once it was read: what was damaged, missing, or not as its metadata has it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from oracle_server.core.errors import one_line
from oracle_server.core.units import counted
from oracle_server.replay.bags.sources import Topic
from oracle_server.replay.files.folder import Files
from oracle_server.replay.files.ownmetadata import files_of_its_bag
from oracle_server.replay.files.storage import Storage
from oracle_server.replay.recording import Note, part_of, passed_beside

_MOST = 5
"""Damages of one file that are told one by one."""
_SEVERAL = 20
"""So many messages are not all of before a recorder has heard the clock of a simulation."""


def notes_of(topics: Iterable[Topic], files: Files, storages: Sequence[Storage]) -> list[Note]:
    """Everything that is to be said of a bag that was read to its end."""
    found = [Note(one_line(text), doubt=True) for text in files.notes]
    if len(storages) == 1 and not files.notes and (count := files_of_its_bag(storages[0])) > 1:
        what = f"{files.paths[0].name}: is one of the {count} files of a bag, and the others were not judged"
        found.append(Note(one_line(f"{what}: judge all together, as a folder or packed by tar"), doubt=True))
    for path, storage in zip(files.paths, storages, strict=True):
        damages = list(dict.fromkeys(storage.damages))
        found += [Note(one_line(f"{path.name}: {damage}"), doubt=True) for damage in damages[:_MOST]]
        if len(damages) > _MOST:
            found.append(
                Note(f"{path.name}: {counted(len(damages) - _MOST, 'more part')} could not be read", doubt=True)
            )
    for topic in topics:
        found += _of_topic(topic)
    return found


def of_times(topics: Iterable[Topic]) -> Iterator[Note]:
    """What is to be said of topics without any time of recording, in a bag where others have some."""
    for topic in topics:
        if topic.role is not None and topic.seen >= _SEVERAL and not topic.timed:
            what = f"its {topic.seen} messages have the time of recording 0, which is none"
            yield Note(f"{topic.name}: {what}, and stand at the beginning", doubt=True)


def of_channels(topic: Topic) -> Iterator[Note]:
    """What is to be said of a topic before it is read: of channels that are not, or are of several types."""
    name = topic.role.streams[0].name if topic.role else ""
    if topic.refused:
        yield Note(one_line(topic.refused), unusable=True, unread=name)
    if not topic.wanted and len(topic.types) > 1:
        names = ", ".join(sorted(topic.types))
        yield Note(one_line(f"{topic.name}: has messages of {len(topic.types)} types: {names}"), doubt=True)
    for type_, count in topic.types.items() if topic.wanted else ():
        if type_ != topic.wanted:
            which = part_of(count, sum(topic.types.values())) if count else "some of its messages are"
            what = f"the type {type_}" if type_ else "a type that the recording does not tell"
            text = f"{topic.name}: {which} of {what}, and the spec says {topic.wanted}: such a message was not judged"
            yield Note(one_line(text), unusable=True, unread=name)


def _of_topic(topic: Topic) -> Iterator[Note]:
    if topic.role is None:
        if topic.gives is not None and topic.gives.others:
            yield passed_beside(topic.name, topic.gives.others)
        return
    yield from _unread(topic, topic.role.streams[0].name)
    if topic.seen < topic.promised:
        what = f"of the {counted(topic.promised, 'message')} that it should have"
        if topic.seen:
            yield Note(f"{topic.name}: {topic.seen} {what} could be read", doubt=True)
        else:
            yield Note(f"{topic.name}: none {what} could be read", unusable=True)
    elif topic.seen > topic.promised:
        yield Note(
            f"{topic.name}: {counted(topic.seen, 'message')} could be read, where {topic.promised} should be there"
        )
    if topic.timeless:
        what = part_of(topic.timeless, topic.seen)
        yield Note(one_line(f"{topic.name}: {what} ordered by arrival: {topic.why_timeless}"), doubt=True)
    if topic.bare:
        what = "service events" if topic.bare > 1 else "service event"
        yield Note(f"{topic.name}: {topic.bare} {what} without content: only metadata was recorded", doubt=True)


def _unread(topic: Topic, name: str) -> Iterator[Note]:
    """Messages that could not be read; `name` is that of the streams."""
    if topic.unreadable:
        what, type_ = counted(topic.seen, "message"), f"could be read as {topic.type}: {topic.why}"
        if topic.unreadable == topic.seen:
            yield Note(f"{topic.name}: none of its {what} {type_}", unusable=True, unread=name)
        else:
            text = f"{topic.name}: {topic.unreadable} of its {what} could not be read: {topic.why}"
            yield Note(text, doubt=True, unread=name)
