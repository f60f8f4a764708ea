"""The schema of spec files, as pydantic models: all keys with their defaults."""

from __future__ import annotations

import contextlib
import re
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    StrictBool,
    StrictInt,
    StrictStr,
    Tag,
    WithJsonSchema,
    model_serializer,
)

from oracle_server.core.kinds import ACTION
from oracle_server.core.spec import GAP, HORIZON, IDENTIFIER, LONGEST_HORIZON
from oracle_server.core.stamps import Epoch, Unit
from oracle_server.core.units import duration, kept, size
from oracle_server.engines.table import ENGINES


def _delay(value: object) -> int | None:
    return None if value == "none" else duration(value)


def _close(value: object) -> int:
    """The nanoseconds of `after 1h`."""
    found = re.fullmatch(r"after +(\S+)", value) if isinstance(value, str) else None
    if found is None:
        raise ValueError(f"expected a time without a monitor such as `after 1h`, found {value!r}{_after(value)}")
    time = duration(found[1])
    if not time:
        raise ValueError("a session is without a monitor when it is opened: write a time longer than 0s")
    return time


def _after(value: object) -> str:
    """What to write for a duration alone."""
    with contextlib.suppress(ValueError):
        return f"; write after {value}" if duration(value) else ""
    return ""


def ros_type(value: str, kind: str) -> str:
    """Normalise `pkg/Type` and `pkg.msg.Type` to `pkg/msg/Type`; of services (`srv`) and actions likewise."""
    package, *rest = value.replace(".", "/").split("/")
    return "/".join((package, kind, *rest) if len(rest) == 1 else (package, *rest))


def _type_key(value: object, kind: str) -> object:
    return ros_type(value, kind) if isinstance(value, str) else value


if TYPE_CHECKING:
    EngineName = str
else:
    EngineName = Literal[tuple(ENGINES)]

_Time = Annotated[str, Field(pattern=r"^\d{1,12}(\.\d{1,9})?(ns|us|ms|s|min|h)$")]
_TypeName = Annotated[str, Field(pattern=r"^(\w+[./]\w+([./]\w+)?)?$")]
Duration = Annotated[int, BeforeValidator(duration, json_schema_input_type=_Time)]
Size = Annotated[int, BeforeValidator(size, Annotated[str, Field(pattern=r"^\d{1,9}[kMG]B$")])]
Delay = Annotated[int | None, BeforeValidator(_delay, json_schema_input_type=_Time | Literal["none"])]
Close = Annotated[int, BeforeValidator(_close, Annotated[str, Field(pattern=r"^after +\d\S*$")])]
Identifier = Annotated[str, Field(pattern=IDENTIFIER)]
RosName = Annotated[str, Field(pattern=r"^[~/A-Za-z][A-Za-z0-9_/{}~]*$", max_length=255)]
MessageType = Annotated[
    str,
    BeforeValidator(partial(_type_key, kind="msg"), _TypeName),
    Field(pattern=r"^(\w+/msg/\w+|\w+/srv/\w+_Event)?$"),
]
ServiceType = Annotated[
    str, BeforeValidator(partial(_type_key, kind="srv"), _TypeName), Field(pattern=r"^(\w+/srv/\w+)?$")
]
ActionType = Annotated[
    str, BeforeValidator(partial(_type_key, kind="action"), _TypeName), Field(pattern=r"^(\w+/action/\w+)?$")
]
FieldPath = Annotated[str, Field(pattern=r"^\w+(\.\w+)*$")]
Asked = Literal["goal", "reply", "feedback", "cancel", "result"]
SignalName = Annotated[str, Field(min_length=1, max_length=128)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class OrderingModel(_Model):
    """`ordering:`."""

    by: Literal["publication", "arrival", "both"] = "publication"
    max_delay: Delay = 200 * 10**6
    late: Literal["judge", "skip", "revise"] = "judge"
    max_skew: Duration = 10**9
    capacity: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = 10_000
    horizon: Annotated[Duration, Field(gt=0, le=LONGEST_HORIZON)] = HORIZON

    @model_serializer(mode="wrap")
    def _meaning(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        meaning: dict[str, Any] = plain(self)
        if self.late != "revise":
            del meaning["horizon"]
        return meaning


class StampModel(_Model):
    """`stamp:` of a topic; the field alone stands for a time, or for seconds since 1970."""

    field: FieldPath
    unit: Unit | None = None
    epoch: Epoch = "unix"

    @model_serializer
    def _meaning(self) -> Any:
        alone = self.unit is None and self.epoch == "unix"
        return self.field if alone else {"field": self.field, "unit": self.unit, "epoch": self.epoch}


def _stamp(value: object) -> object:
    if isinstance(value, str):
        return {"field": value}
    if not isinstance(value, dict | StampModel | None):
        wanted = "a field such as header.stamp, or {field: time, unit: us, epoch: boot}"
        raise ValueError(f"expected {wanted}, found {value!r}")  # noqa: TRY004 -- pydantic reports no others
    return value


class ChannelModel(_Model):
    """The keys of a topic, or of the requests or responses of a service."""

    hold: list[SignalName] = []
    signals: dict[SignalName, StrictStr] | None = None
    each: StrictStr | None = None

    @model_serializer(mode="wrap")
    def _meaning(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        meaning: dict[str, Any] = plain(self)
        if self.each is None:  # so that specs without it keep the digest that older versions gave them
            del meaning["each"]
        return meaning


class HalfModel(ChannelModel):
    """The requests or the responses of a service."""

    stamp: FieldPath | None = None


class _Interface(_Model):
    latency: Duration = 20 * 10**6
    ordered: StrictBool = True
    causes: list[RosName] = []
    action: Literal["log", "filter"] = "log"
    on_unavailable: Literal["deny", "pass"] = "deny"
    decide_within: Duration = 2 * 10**9
    on_deny: Literal["keep", "undo"] = "keep"


class TopicModel(ChannelModel, _Interface):
    """A topic: one stream."""

    topic: RosName
    stamp: Annotated[StampModel | None, BeforeValidator(_stamp, FieldPath | StampModel | None)] = None
    type: MessageType = ""
    intercept: Literal["publisher", "subscriber"] = "publisher"


class ServiceModel(_Interface):
    """A service: two streams, its requests and its responses."""

    service: RosName
    type: ServiceType = ""
    proxy: RosName | None = None
    denied_response: dict[str, Any] | None = None
    request: HalfModel = HalfModel()
    response: HalfModel = HalfModel()


class PartModel(HalfModel):
    """The events of one kind of an action."""

    ordered: StrictBool | None = None


Part = Annotated[PartModel | None, BeforeValidator(lambda given: {} if given is None else given)]
"""A section of an action, which may be written without any keys; None where it is not there."""


class ActionModel(_Interface):
    """An action: a stream for each kind of its events that is described, or asked."""

    ros_action: RosName
    type: ActionType = ""
    proxy: RosName | None = None
    via: Literal["proxy", "introspection"] = "proxy"
    ask: list[Asked] | None = None
    denied_result: dict[str, Any] | None = None
    goal: Part = None
    reply: Part = None
    feedback: Part = None
    cancel: Part = None
    result: Part = None
    status: Part = None

    @property
    def asked(self) -> tuple[Asked, ...]:
        """The kinds on which is decided."""
        if self.action == "log":
            return ()
        return tuple(dict.fromkeys(self.ask)) if self.ask else ("goal",)


def _stream_kind(value: object) -> str:
    return next((group for group in ("service", ACTION) if isinstance(value, dict) and group in value), "topic")


StreamModel = Annotated[
    Annotated[TopicModel, Tag("topic")] | Annotated[ServiceModel, Tag("service")] | Annotated[ActionModel, Tag(ACTION)],
    Discriminator(_stream_kind),
]


class PropertyModel(_Model):
    """A property."""

    id: Identifier
    description: StrictStr = ""
    formula: StrictStr | None = None
    pattern: StrictStr | None = None
    requirement: StrictStr | None = None
    machine: StrictStr | None = None
    time: Literal["steps", "seconds"] = "steps"
    guards: list[RosName] = []
    blame: Literal["any", "caused"] = "any"
    latch: StrictBool = False
    at_end: Literal["ignore", "violated"] = "ignore"
    engine: EngineName = "auto"
    url: Annotated[str, Field(pattern=r"^wss?://")] | None = None
    timeout: Annotated[Duration, Field(gt=0)] = 10**9
    streams: list[RosName] | None = None
    names: Literal["full", "bare"] = "full"


class RetentionModel(_Model):
    """`retention:`, the limits on the history of this spec's sessions."""

    age: Annotated[Duration, AfterValidator(kept)] | None = None
    events: Annotated[StrictInt, Field(ge=1)] | None = None
    size: Annotated[Size, AfterValidator(kept)] | None = None


class EpisodesModel(_Model):
    """`episodes:`, which violations are told as one."""

    gap: Duration = GAP


def _over(value: object) -> tuple[int, bool]:
    """A window: nanoseconds, or, with true behind it, samples."""
    if isinstance(value, int) and not isinstance(value, bool):
        if value < 1:
            raise ValueError(f"a window has at least 1 sample, found {value}")
        return value, True
    found = duration(value)
    if not found:
        raise ValueError("a window is longer than 0s")
    return found, False


def _derived(value: object) -> object:
    """A derived signal: a text alone is its expression."""
    return {"expression": value} if isinstance(value, str) else value


def _listed(value: object) -> object:
    """One name or several."""
    return [value] if isinstance(value, str) else value


_FEW = Field(min_length=1, max_length=4)
_By = SignalName | Annotated[list[SignalName], _FEW]


def _state(value: object) -> object:
    """A state's name: numbers and the like as they are written."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value) if isinstance(value, int) else value


State = Annotated[StrictStr, BeforeValidator(_state, str | int | bool)]
_ROW: Any = {
    "anyOf": [
        {"type": "object", "additionalProperties": {"type": ["string", "integer", "boolean"]}},
        {"type": "array", "items": {"type": ["string", "integer", "boolean"]}},
        {"type": "null"},
    ]
}
"""The states that may follow one, or the events that lead from it."""


class DeriveModel(_Model):
    """A derived signal: one operation with its operand, and its window; or a machine."""

    expression: StrictStr | None = None
    count: StrictStr | None = None
    rate: StrictStr | None = None
    sum: StrictStr | None = None
    mean: StrictStr | None = None
    min: StrictStr | None = None
    max: StrictStr | None = None
    last: StrictStr | None = None
    previous: StrictStr | None = None
    delta: StrictStr | None = None
    age: StrictStr | None = None
    over: Annotated[tuple[int, bool] | None, BeforeValidator(_over, _Time | Annotated[int, Field(ge=1)])] = None
    by: Annotated[tuple[SignalName, ...], _FEW, BeforeValidator(_listed, _By)] | None = None
    forget: Annotated[Duration, Field(gt=0)] | None = None
    follows: SignalName | None = None
    states: dict[SignalName, Annotated[Any, WithJsonSchema(_ROW)]] | None = None
    start: State | None = None
    otherwise: State | None = None
    sequence: StrictStr | None = None

    @model_serializer(mode="wrap")
    def _meaning(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        meaning: dict[str, Any] = plain(self)
        for key in ("follows", "states", "start", "otherwise", "sequence"):  # older versions knew none of these
            if meaning[key] is None:
                del meaning[key]
        if self.by is not None and len(self.by) == 1:
            meaning["by"] = self.by[0]
        if self.states is not None:  # of several events that hold the first one counts
            rows = self.states.items()
            meaning["states"] = [(name, list(row.items()) if isinstance(row, dict) else row) for name, row in rows]
        return meaning


class SpecModel(_Model):
    """A whole spec file."""

    id: Identifier
    description: StrictStr = ""
    ordering: OrderingModel = OrderingModel()
    retention: RetentionModel = RetentionModel()
    episodes: EpisodesModel = EpisodesModel()
    close: Close | None = None
    streams: Annotated[list[StreamModel], Field(min_length=1)]
    define: dict[SignalName, StrictStr] = {}
    derive: dict[SignalName, Annotated[DeriveModel, BeforeValidator(_derived, str | DeriveModel)]] = {}
    properties: Annotated[list[PropertyModel], Field(min_length=1)]
