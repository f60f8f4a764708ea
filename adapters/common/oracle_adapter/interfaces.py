"""The streams that a server describes, by the topics, services and actions that they belong to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterable, List, Mapping, Tuple

from oracle_adapter.kinds import KINDS
from oracle_adapter.names import PROXY

if TYPE_CHECKING:
    from oracle_adapter.board import Board
    from oracle_adapter.kinds import InterfaceType
    from oracle_adapter.link import Link

Stream = Mapping[str, Any]
"""A stream as the server describes it in `attached`."""


@dataclass(frozen=True)
class Interface:
    """A topic, a service or an action: what one part of an adapter observes."""

    type: InterfaceType
    name: str
    streams: Mapping[str, Stream]
    """Its streams by their kinds."""

    @property
    def first(self) -> Stream:
        """The first stream whose events answer no others: of the messages, requests or goals."""
        streams = self.streams
        asking = (s for kind, s in streams.items() if KINDS[kind].answers is None)
        return next(asking, next(iter(streams.values())))

    @property
    def filtered(self) -> bool:
        """Whether events of it pass only where the oracle allows them."""
        return any(is_filtered(stream) for stream in self.streams.values())

    @property
    def proxy(self) -> str:
        """The spec's name of what stands in its place; empty where nothing does."""
        if self.type == "topic":
            return self.name + PROXY if self.filtered else ""
        return str(self.first.get("proxy") or "")


def is_filtered(stream: Stream) -> bool:
    """Whether events of a stream pass only where the oracle allows them."""
    return stream["action"] == "filter" and KINDS[stream["kind"]].can_be_withheld


def interfaces_of(streams: Iterable[Stream]) -> List[Interface]:
    """The interfaces in the order of their first streams; streams of unknown kinds are left out."""
    found: Dict[Tuple[InterfaceType, str], Dict[str, Stream]] = {}
    for stream in streams:
        kind = KINDS.get(stream["kind"])
        if kind is not None:
            found.setdefault((kind.of, stream["name"]), {})[kind.name] = stream
    return [Interface(type_, name, by_kind) for (type_, name), by_kind in found.items()]


def report_unknown(streams: Iterable[Stream], board: Board, link: Link) -> None:
    """Show people and the server which streams an adapter of this version can't observe."""
    for stream in streams:
        name, kind = stream["name"], stream["kind"]
        if kind not in KINDS:
            trouble = (
                f"it is not observed: this adapter does not support streams of the kind '{kind}'"
            )
            board.trouble(name, trouble)
            link.report(name, kind, trouble=trouble)
