"""Streams that a spec observes twice: by two spellings of a name, and services by what they tell of their calls."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.errors import SpecProblem
from oracle_server.core.spec import Spec

_EVENTS = "/_service_event"


def called_twice(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings about the topics of services that are streams, too: each call is a step of both, or of one alone."""
    services = {stream.name for stream in spec.streams if stream.traits.group == "service"}
    for i, stream in enumerate(spec.streams):
        service = stream.name.removesuffix(_EVENTS)
        if stream.kind == "topic" and service != stream.name and service in services:
            message = (
                f"{stream.name} tells of the calls of {service}, which the spec observes itself: a robot's calls are "
                f"steps of both, and a bag's are those of the service alone; leave one of the two out"
            )
            yield SpecProblem(("streams", i, "topic"), message, severity="warning")


def spelt_twice(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings about names that differ by the leading slash alone, which robots and recordings do not tell apart."""
    names = {stream.name for stream in spec.streams}
    for i, stream in enumerate(spec.streams):
        if stream.leads and f"/{stream.name}" in names:
            message = (
                f"'{stream.name}' and '/{stream.name}' are one name on a robot's graph: adapters refuse to observe it "
                f"twice, and a recording's events are those of one alone; leave '{stream.name}' out"
            )
            yield SpecProblem(("streams", i, stream.traits.group), message, severity="warning")
