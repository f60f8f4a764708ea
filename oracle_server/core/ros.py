"""What a spec would not do as its author wants on one version of ROS."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from oracle_server.core.errors import Problem
from oracle_server.core.spec import Spec

Ros = Literal[1, 2]


def ros_hazards(spec: Spec, ros: Ros) -> Iterator[Problem]:
    """What `check --ros` warns of."""
    if ros == 2:
        yield from _denied_responses(spec)


def _denied_responses(spec: Spec) -> Iterator[Problem]:
    """ROS 2 has no service errors: without a word from the spec a denied call is answered by the type's defaults."""
    for i, stream in enumerate(spec.streams):
        if stream.kind == "request" and stream.action == "filter" and stream.denied_response is None:
            yield Problem(
                ("streams", i, "action"),
                f"{stream.name} is filtered without a `denied_response`: on ROS 2 a denied call is answered by the "
                "defaults of the response's type, which a client may take for a success",
                severity="warning",
            )
