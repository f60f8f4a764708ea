"""Names of signals that one stream holds and another one has too."""

from __future__ import annotations

from oracle_server.core.hazards import inspect
from oracle_server.core.spec import Spec, StreamSpec
from tests.core.sessions import prop


def test_a_signal_that_another_stream_holds_is_warned_of() -> None:
    """Not refused: sessions with such specs are in histories, and would not be restored."""
    holds = StreamSpec("/mode", hold=frozenset({"mode"}), signals={"mode": "msg.mode"})
    others = (StreamSpec("/a", signals={"mode": "msg.mode", "v": "msg.v"}), StreamSpec("/b"))
    (found,) = inspect(Spec("s", (holds, *others), (prop("p", "{mode: 1}"),)))
    assert (found.severity, found.path) == ("warning", ("streams", 1, "signals", "mode"))
    assert "held by /mode" in found.message
