"""What the board shows things on: an adapter's topics and its log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Sequence, Tuple

from oracle_adapter import logs
from oracle_adapter.texts import one_line

if TYPE_CHECKING:
    from typing import Protocol

    class Screen(Protocol):
        """Where people look; its methods are called in any thread."""

        def verdict(self, outcome: str) -> None:
            """Publish the worst outcome over the properties on `monitor_verdict`."""

        def error(self, text: str) -> None:
            """Log an error, and publish it on `monitor_error`."""

        def info(self, text: str) -> None:
            """Log a text."""

        def diagnostics(self, statuses: Sequence[Status]) -> None:
            """Publish these on `/diagnostics`."""


OK, WARN, ERROR, STALE = 0, 1, 2, 3
"""The levels of `diagnostic_msgs/DiagnosticStatus`."""
LEVELS = {"ok": OK, "warn": WARN, "error": ERROR, "stale": STALE}
"""The levels by the server's names for them."""


@dataclass(frozen=True)
class Status:
    """One `diagnostic_msgs/DiagnosticStatus`; its `hardware_id` is the monitor's name."""

    name: str
    level: int
    message: str
    values: Tuple[Tuple[str, str], ...] = ()


class SafeScreen:
    """Another screen, that gets printable lines, and whose exceptions are logged and go no further.

    What is shown is about messages that wait to be passed on: a broken screen must not stop them.
    The same exception in succession is logged once.
    """

    def __init__(self, screen: Screen) -> None:
        self._screen = screen
        self._logged = ""

    def verdict(self, outcome: str) -> None:
        """Show the worst outcome over the properties."""
        self._show(self._screen.verdict, outcome)

    def error(self, text: str) -> None:
        """Show an error."""
        self._show(self._screen.error, one_line(text))

    def info(self, text: str) -> None:
        """Show a text."""
        self._show(self._screen.info, one_line(text))

    def diagnostics(self, statuses: Sequence[Status]) -> None:
        """Show the statuses."""
        self._show(self._screen.diagnostics, [_printable(status) for status in statuses])

    def _show(self, show: Callable[[Any], None], what: Any) -> None:
        try:
            show(what)
        except Exception as error:  # noqa: BLE001 - whatever it is
            if repr(error) != self._logged:
                self._logged = repr(error)
                logs.failure("the screen failed to show %r", what)


def _printable(status: Status) -> Status:
    values = tuple((name, one_line(value)) for name, value in status.values)
    return Status(one_line(status.name), status.level, one_line(status.message), values)
