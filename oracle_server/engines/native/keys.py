"""Keys: which values the variables of a part of a formula have.

The key of a part without variables is `()`, with one variable its value's canonical text, with more the tuple of
their texts, outermost quantifier first. `None` in a text's place is the *fresh* value: any that is not distinguished. A
region is a tuple in which `ALL` stands for every value, fresh and known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter
from types import EllipsisType
from typing import Any

Text = str | None
Key = Any
"""`()`, a text or None, or a tuple of two and more of these."""
Variables = tuple[int, ...]
ALL = ...
Region = Sequence[Text | EllipsisType]


def fresh_key(size: int) -> Key:
    """The key with the fresh value for each of `size` variables."""
    return () if size == 0 else None if size == 1 else (None,) * size


def key_of(texts: Sequence[Any]) -> Key:
    """The key of a sequence of texts."""
    return texts[0] if len(texts) == 1 else tuple(texts)


def texts_of(key: Key) -> tuple[Text, ...]:
    """The texts of a key, in order."""
    return key if isinstance(key, tuple) else (key,)


def read_key(data: Any) -> Key:
    """A key out of plain data, where tuples are lists."""
    return tuple(data) if isinstance(data, list) else data


def is_fresh(key: Key) -> bool:
    """Whether some variable has the fresh value, or there is no variable."""
    return key is None or key == () or (isinstance(key, tuple) and None in key)


def picker(places: Sequence[int], size: int) -> Callable[[Key], Key] | None:
    """What takes the key of some places out of a key of `size` variables, None where that is the key itself."""
    if tuple(places) == tuple(range(size)):
        return None
    if not places:
        return lambda _: ()
    return itemgetter(*places)
