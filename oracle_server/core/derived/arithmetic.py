"""An expression over the signals of a step, held and derived ones too."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import Asked, Session
from oracle_server.core.events import Signals
from oracle_server.core.expression import MAX_STEPS, Absent, Failed
from oracle_server.core.signals import is_signal


class Arithmetic:
    """It has no state: it is computed of what formulas see so far."""

    __slots__ = ("_names", "_run", "_slots", "last")

    def __init__(self, definition: Definition, _session: Session) -> None:
        expression = definition.expression
        self._run, self._slots = expression.code.run, expression.slots
        self._names = definition.operands
        self.last = 0

    def take(self, _sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Nothing is kept; returns its value."""
        return self.value(now, number, signals, failed)

    def value(self, _now: int, _number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Its value."""
        if failed and any(name in failed for name in self._names):
            signals = _Lacking(signals, failed)
        try:
            value = self._run(signals, [MAX_STEPS, *[None] * self._slots])
        except Absent:
            return None
        except Exception:  # noqa: BLE001 no fault of an expression's evaluation ends a session
            return FAILED
        if value is None or is_signal(value):
            return value  # type: ignore[no-any-return]
        return FAILED

    def at(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Its value at a tick."""
        return self.value(now, number, signals, failed)

    def next_change(self, _after: int, _asked: Asked) -> int | None:
        """Time alone is taken to change nothing."""
        return None

    def settled(self, _now: int, _number: int) -> bool:
        """It keeps nothing."""
        return True

    def snapshot(self) -> Any:
        """Nothing."""
        return []

    def restore(self, data: Any) -> None:
        """Nothing."""


class _Lacking(dict[str, Any]):
    """Signals of which some have failed: whoever reads one of these, or asks whether it is there, fails."""

    def __init__(self, signals: Signals, failed: Collection[str]) -> None:
        super().__init__(signals)
        self._failed = failed

    def __getitem__(self, name: str) -> Any:
        self._demand(name)
        return super().__getitem__(name)

    def __contains__(self, name: object) -> bool:
        self._demand(name)
        return super().__contains__(name)

    def get(self, name: str, default: Any = None) -> Any:
        self._demand(name)
        return super().get(name, default)

    def _demand(self, name: object) -> None:
        if name in self._failed:
            raise Failed(f"{name} has failed")
