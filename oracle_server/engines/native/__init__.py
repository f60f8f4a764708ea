"""The project's own engine: exact for every formula and both clocks, at a cost that follows what changes."""

from oracle_server.engines.native.engine import NativeEngine

__all__ = ["NativeEngine"]
