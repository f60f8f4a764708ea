"""A frame that is wrong in many places is refused at the first, and one that tells of too many streams at once."""

from __future__ import annotations

import json
from typing import Any

import pytest
from pydantic import ValidationError

from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import (
    MAX_STREAMS,
    Attach,
    ClockMessage,
    HandlingsMessage,
    ReportMessage,
)
from oracle_server.wire.reading import decode

WRONG: dict[str, tuple[type[Any], dict[str, Any]]] = {
    "attach": (Attach, {"type": "attach", "monitor": "m", "instance": "i", "streams": [1] * 100}),
    "clock": (ClockMessage, {"type": "clock", "stamps": [1] * 100}),
    "report": (ReportMessage, {"type": "report", "streams": [1] * 100}),
    "outcomes": (HandlingsMessage, {"type": "outcomes", "outcomes": [1] * 100}),
}


@pytest.mark.parametrize(("model", "frame"), WRONG.values(), ids=WRONG)
def test_only_the_first_wrong_part_is_worded(model: type[Any], frame: dict[str, Any]) -> None:
    with pytest.raises(ValidationError) as found:
        model.model_validate(frame)
    assert found.value.error_count() == 1
    with pytest.raises(WireError, match=r"\.0: Input should be"):
        decode(json.dumps(frame))


@pytest.mark.parametrize("kind", ["clock", "report"])
@pytest.mark.parametrize(("more", "refused"), [(0, False), (1, True)])
def test_a_frame_tells_of_so_many_streams(kind: str, more: int, refused: bool) -> None:
    told = [{"stream": "/a", "stamp": 1}] * (MAX_STREAMS + more)
    text = json.dumps({"type": kind, "stamps" if kind == "clock" else "streams": told})
    if refused:
        with pytest.raises(WireError, match="at most"):
            decode(text)
    else:
        decode(text)
