"""The project's own engine: exact for every formula and both clocks, at a cost that follows what changes."""

from oracle_server.engines.native.engine import NativeEngine
from oracle_server.engines.native.guarding import engine_of

__all__ = ["NativeEngine", "engine_of"]
