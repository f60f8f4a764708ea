"""Three servers over one PostgreSQL, each of which reaches it past a relay of its own, and what may happen to them."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Self

from tests.chaos.fleet import Fleet
from tests.chaos.link import Link
from tests.chaos.served import Served
from tests.postgres import Postgres, Relay
from tests.processes import PATIENCE

LEASE = 3.0
"""Seconds of a server's lease."""
NAMES = "abc"
_QUICK = "from oracle_server.history.postgres import store; store.PATIENCE = 2.0"
"""A connection that is silent is soon given up: where no fault makes it so, only a slow machine would."""


class Cluster:
    """The servers of a fleet with their database; each of its methods that is in `FAULTS` is a fault, and its end."""

    def __init__(self, postgres: Postgres, specs: Path, folder: Path, chance: random.Random, *, silences: bool) -> None:
        """Three servers; `silences`: whether PostgreSQL will be silent."""
        self._prelude = _QUICK if silences else ""
        self._postgres, self._chance = postgres, chance
        self._relays = {name: Relay(postgres) for name in NAMES}
        self._part = postgres.part()
        self.links: list[Link] = []
        self.fleet = Fleet({name: self._server(name, specs, folder / name) for name in NAMES})

    def _server(self, name: str, specs: Path, data: Path) -> Served:
        url = self._postgres.past(self._relays[name], self._part)
        return Served(
            specs, data, prelude=self._prelude, history=url, node=name, advertise=f"http://{name}",
            lease=str(LEASE), resume_within="600",
        )  # fmt: skip

    async def __aenter__(self) -> Self:
        """Start all servers."""
        await self.fleet.__aenter__()
        return self

    async def __aexit__(self, *failed: object) -> None:
        """End all."""
        await self.fleet.__aexit__(*failed)
        for relay in self._relays.values():
            relay.close()

    async def whole(self) -> None:
        """Wait until all servers accept work."""
        async with asyncio.timeout(PATIENCE):
            for node in self.fleet.nodes.values():
                await node.up.wait()

    async def one_is_killed(self) -> None:
        """It is started again at once, by the same name."""
        self.fleet.nodes[await self._victim()].kill()
        await self.whole()

    async def two_are_killed(self) -> None:
        struck = await self._victim()
        for name in (struck, self._chance.choice([other for other in NAMES if other != struck])):
            self.fleet.nodes[name].kill()
        await self.whole()

    async def one_stands_until_another_has_taken_over(self) -> None:
        """Some of its monitors go elsewhere meanwhile; it ends once it goes on."""
        name = await self._victim()
        node = self.fleet.nodes[name]
        node.freeze()
        node.up.clear()
        self._cut_some()
        await self._taken_from(name)
        node.thaw()
        await self.whole()

    async def one_stands_for_a_moment(self) -> None:
        """Its lease, which it renews three times while one lasts, does not run out, on a slow machine neither."""
        node = self.fleet.nodes[await self._victim()]
        node.freeze()
        await asyncio.sleep(LEASE * self._chance.uniform(0.1, 0.5))  # waits for nothing: it is how long it stands
        node.thaw()

    async def connections_to_postgresql_end(self) -> None:
        await asyncio.to_thread(self._postgres.kill_backends)

    async def postgresql_is_killed(self) -> None:
        await asyncio.to_thread(self._postgres.kill)
        await asyncio.to_thread(self._postgres.start)

    async def postgresql_and_one_are_killed(self) -> None:
        node = self.fleet.nodes[await self._victim()]
        await asyncio.to_thread(self._postgres.kill)
        node.kill()
        await asyncio.to_thread(self._postgres.start)
        await self.whole()

    async def one_does_not_reach_postgresql(self) -> None:
        """What it has sent arrives late, once another one has taken over."""
        name = await self._victim()
        self.fleet.nodes[name].up.clear()
        self._relays[name].fall_silent()
        await self._taken_from(name)
        self._relays[name].speak()
        await self.whole()

    async def the_relay_cuts(self) -> None:
        self._relays[await self._victim()].cut()

    async def postgresql_is_killed_as_monitors_come_back(self) -> None:
        """What was decided for them is read again meanwhile."""
        for link in self.links:
            link.cut()
        await asyncio.sleep(self._chance.uniform(0.0, 0.5))  # waits for nothing: it is how far they come
        await self.postgresql_is_killed()

    async def monitors_are_cut_off(self) -> None:
        self._cut_some()

    def _cut_some(self) -> None:
        for link in self._chance.sample(self.links, len(self.links) // 2):
            link.cut()

    async def _victim(self) -> str:
        """One that has sessions."""
        return self._chance.choice(sorted({node for node, _ in await self.owners()}))

    async def owners(self) -> Sequence[tuple[str, str]]:
        """Of each open session its node and its name."""
        rows = await asyncio.to_thread(self._postgres.do, "SELECT node, id FROM owners", self._postgres.url(self._part))
        return [(str(node), str(session)) for node, session in rows]

    async def _taken_from(self, name: str) -> None:
        async with asyncio.timeout(PATIENCE):
            while any(node == name for node, _ in await self.owners()):
                await asyncio.sleep(0.02)


Fault = Callable[[Cluster], Awaitable[None]]
FAULTS: tuple[Fault, ...] = (
    Cluster.one_is_killed,
    Cluster.one_stands_until_another_has_taken_over,
    Cluster.postgresql_is_killed,
    Cluster.one_does_not_reach_postgresql,
    Cluster.connections_to_postgresql_end,
    Cluster.two_are_killed,
    Cluster.the_relay_cuts,
    Cluster.postgresql_and_one_are_killed,
    Cluster.monitors_are_cut_off,
    Cluster.one_stands_for_a_moment,
    Cluster.postgresql_is_killed_as_monitors_come_back,
)

SPOILING: frozenset[Fault] = frozenset(
    {
        Cluster.postgresql_is_killed,
        Cluster.postgresql_is_killed_as_monitors_come_back,
        Cluster.one_does_not_reach_postgresql,
        Cluster.connections_to_postgresql_end,
        Cluster.the_relay_cuts,
        Cluster.postgresql_and_one_are_killed,
    }
)
"""Those while which a server may have no PostgreSQL, and answers what is asked without judging it."""


def name_of(fault: Fault) -> str:
    """A fault's name, in words."""
    return str(fault.__name__).replace("_", " ")
