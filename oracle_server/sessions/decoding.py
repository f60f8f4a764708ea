"""The decoders of a session's streams, each of which keeps what the session reads of its data."""

from __future__ import annotations

from typing import cast

from oracle_server.core.events import StreamKey
from oracle_server.core.kinds import StepKind
from oracle_server.core.plan import Plan
from oracle_server.wire.data import DataDecoder, data_decoder, nothing


class Decoders:
    """Makes each decoder once."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._made: dict[tuple[str, str], DataDecoder] = {}

    def __call__(self, stream: str, kind: str) -> DataDecoder:
        """The decoder of a stream's data; events of one that the spec has not are refused."""
        found = self._made.get((stream, kind))
        if found is None:
            known = self._plan.streams.get(StreamKey(stream, cast("StepKind", kind)))
            if known is None:
                return nothing(stream, kind)
            found = self._made[stream, kind] = data_decoder(known.decoded)
        return found
