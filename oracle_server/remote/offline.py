"""The external oracles of a replay, which waits for the answer to each question."""

from __future__ import annotations

import asyncio

from oracle_server.core.asking import Ask
from oracle_server.core.engine import Answer
from oracle_server.core.errors import OracleError
from oracle_server.core.events import Order
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged
from oracle_server.remote.oracle import ExternalOracle


class OfflineOracles:
    """Asks a session's oracles one question at a time; each order has connections of its own."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._runner = asyncio.Runner()
        self._oracles: dict[tuple[Order, int], ExternalOracle] = {}
        for order in session.judges:
            for index in session.plan.external:
                prop = session.plan.spec.properties[index]
                assert prop.external is not None  # noqa: S101 -- the plan lists external properties
                self._oracles[order, index] = ExternalOracle(prop.external)

    def settle(self) -> list[Judged]:
        """Ask all questions of the session, and return the steps that it judged by the answers.

        Raises `OracleError` where an oracle can't be reached for its first question.
        """
        judged: list[Judged] = []
        while asks := self._session.take_asks():
            for ask in asks:
                oracle = self._oracles[ask.order, ask.property]
                if not oracle.used and isinstance(ask.step.event.data, dict):
                    self._connect(oracle, ask.property)
                judged += self._session.resolve(ask, self._runner.run(_ask(oracle, ask)), self._session.now)
        return judged

    def _connect(self, oracle: ExternalOracle, index: int) -> None:
        reason = self._runner.run(_connect(oracle))
        if reason is not None:
            raise OracleError(f"{self._session.plan.spec.properties[index].text} {reason}; start it first")

    def close(self) -> None:
        """Close the connections."""
        for oracle in self._oracles.values():
            self._runner.run(oracle.close())
        self._runner.close()


async def _connect(oracle: ExternalOracle) -> str | None:
    return await oracle.connect(asyncio.get_running_loop().time() + oracle.timeout)


async def _ask(oracle: ExternalOracle, ask: Ask) -> Answer:
    return await oracle.ask(ask, asyncio.get_running_loop().time() + oracle.timeout)
