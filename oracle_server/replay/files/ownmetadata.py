"""The metadata of its bag that a file itself has: a file that is judged alone tells by it that there were others."""

from __future__ import annotations

import yaml

from oracle_server.replay.files.storage import Storage


def files_of_its_bag(storage: Storage) -> int:
    """How many files a bag had, at least, one of which is this; 1 where the file has all, or tells nothing of it."""
    messages = sum(channel.promised or 0 for channel in storage.channels)
    return max((_files(text, messages) for text in storage.described), default=1)


def _files(text: str, messages: int) -> int:
    """How many files metadata names whose bag had more than so many messages, as of files that were not merged."""
    try:
        told = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506 -- both are safe
        told = told.get("rosbag2_bagfile_information", told)
        names, count = told["relative_file_paths"], told["message_count"]
        return len(set(names)) if isinstance(names, list) and int(count) > messages else 1
    except (AttributeError, ValueError, TypeError, LookupError, RecursionError, yaml.YAMLError):
        return 1
