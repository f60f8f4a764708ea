"""A client of Foxglove's protocol over WebSocket: it is told of channels, subscribes, and reads their messages."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import struct
from collections.abc import AsyncIterator, Callable
from typing import Any, NamedTuple

from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.foxglove.reading import fields
from tests.processes import PATIENCE

_DATA = struct.Struct("<BIQ")


class Seen(NamedTuple):
    """A message as it came, with the time that it bears (ns)."""

    topic: str
    time: int
    data: dict[str, Any]


class Viewer:
    """One connection; it subscribes to the channels that are `wanted` as soon as it is told of them."""

    def __init__(self, socket: ClientConnection, wanted: Callable[[str], bool]) -> None:
        self.socket, self._wanted = socket, wanted
        self.channels: dict[int, dict[str, Any]] = {}
        self._names: dict[int, str] = {}  # of those that are gone, too: what was sent before may come after that
        self.seen: list[Seen] = []

    @property
    def topics(self) -> set[str]:
        """The names of the channels that there are at present."""
        return {channel["topic"] for channel in self.channels.values()}

    def shape(self, topic: str) -> dict[str, str]:
        """The fields of a channel."""
        (channel,) = [channel for channel in self.channels.values() if channel["topic"] == topic]
        return fields(json.loads(channel["schema"]))

    def of(self, topic: str) -> list[Seen]:
        """What came of a channel."""
        return [seen for seen in self.seen if seen.topic == topic]

    async def heard(self) -> None:
        """Read until there is a message."""
        await self.until(lambda: self.seen)

    async def until(self, good: Callable[[], object]) -> None:
        """Read until something is so."""
        async with asyncio.timeout(PATIENCE):
            while not good():
                await self._take(await self.socket.recv())

    async def _take(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            kind, number, time = _DATA.unpack_from(message)
            assert kind == 1
            seen = Seen(self._names[number], time, json.loads(message[_DATA.size :]))
            if self.of(seen.topic)[-1:] != [seen]:  # the last one is repeated for who subscribes
                self.seen.append(seen)
            return
        told = json.loads(message)
        if told["op"] == "advertise":
            for channel in told["channels"]:
                assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
                self.channels[channel["id"]] = channel
                self._names[channel["id"]] = channel["topic"]
            await self._subscribe([c["id"] for c in told["channels"] if self._wanted(c["topic"])])
        elif told["op"] == "unadvertise":
            for number in told["channelIds"]:
                del self.channels[number]
        elif told["op"] == "status":
            # the channel was offered anew meanwhile, with more signals; or the library tells of it before it knows it
            assert told["message"].startswith("Unknown channel ID")
            await self._subscribe([n for n in map(int, re.findall(r"[0-9]+", told["message"])) if n in self.channels])
        else:
            assert told["op"] in ("serverInfo", "removeStatus"), told
            assert told.get("capabilities", []) == []

    async def _subscribe(self, numbers: list[int]) -> None:
        subscriptions = [{"id": number, "channelId": number} for number in numbers]
        await self.socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))


@contextlib.asynccontextmanager
async def viewing(url: str, wanted: Callable[[str], bool] = lambda _: True) -> AsyncIterator[Viewer]:
    """A viewer of what is offered at an address."""
    async with connect(url, subprotocols=[Subprotocol("foxglove.sdk.v1")], proxy=None, open_timeout=PATIENCE) as socket:
        yield Viewer(socket, wanted)
