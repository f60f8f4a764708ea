"""Actions in spec files: their streams, one for each kind of events that is described or asked, and what can't be."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from oracle_server.core.errors import Finding, SpecProblem
from oracle_server.core.kinds import ACTION, OF_ACTIONS
from oracle_server.core.spec import StreamSpec
from oracle_server.specfiles.document import Document
from oracle_server.specfiles.model import ActionModel, PartModel


def action_streams(
    model: ActionModel, common: Mapping[str, Any], channel: Callable[[PartModel], Mapping[str, Any]]
) -> Iterator[StreamSpec]:
    """The streams of an action; `common` is what all of them have, `channel` what a section has."""
    shared = dict(common) | {
        "proxy": model.proxy or f"{model.ros_action}_mon",
        "via": model.via,
        "denied_result": model.denied_result,
        "first": True,
    }
    for kind in OF_ACTIONS:
        part: PartModel | None = getattr(model, kind)
        asked = kind in model.asked
        if part is None and not asked:
            continue
        own = {**shared, **channel(part or PartModel()), "action": "filter" if asked else "log"}
        if part is not None and part.ordered is not None:
            own["ordered"] = part.ordered
        if kind == "cancel":  # a robot can be stopped whatever becomes of the oracle
            own["on_unavailable"] = "pass"
        yield StreamSpec(model.ros_action, kind, **own)
        shared["first"] = False


def action_findings(document: Document, streams: Sequence[object]) -> Iterator[Finding]:
    """What makes an action unusable: it observes nothing, or is to withhold what it only hears of."""
    for i, model in enumerate(streams):
        if not isinstance(model, ActionModel):
            continue
        where = f"stream '{model.ros_action}': "
        if model.action == "filter" and model.via == "introspection":
            yield Finding(
                document.file,
                *document.place(("streams", i, "via")),
                f"{where}`via: introspection` hears of what has happened, so that nothing can be denied; leave `via` "
                "out, or write `action: log`",
            )
        elif model.action == "filter" and model.ask == []:
            message = f"{where}nothing of it is asked, so that nothing can be denied; write `ask: [goal]`"
            yield Finding(document.file, *document.place(("streams", i, "ask")), message)
        elif not model.asked and not any(getattr(model, kind) for kind in OF_ACTIONS):
            message = f"{where}it says nothing of what is observed; write a key for each kind, as `goal: {{}}`"
            yield Finding(document.file, *document.place(("streams", i, ACTION)), message)


def action_problems(streams: Sequence[object], places: Sequence[int]) -> Iterator[SpecProblem]:
    """Keys of actions that have no effect; `places` are those in the file of the spec's streams."""
    for i, model in enumerate(streams):
        if isinstance(model, ActionModel):
            for key, why in _idle(model):
                message = f"`{key}` has no effect on {model.ros_action}, {why}"
                yield SpecProblem(("streams", places.index(i), key), message, severity="warning")


def _idle(model: ActionModel) -> Iterator[tuple[str, str]]:
    if model.ask is not None and model.action == "log":
        yield "ask", "which is only logged: nothing of it is denied; write `action: filter`, or leave the key out"
    if model.proxy is not None and model.via == "introspection":
        yield "proxy", "which has none with `via: introspection`; leave one of both out"
    if model.denied_result is not None and "result" not in model.asked:
        yield "denied_result", "of which no result is denied; name `result` under `ask`, or leave the key out"
