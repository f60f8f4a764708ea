"""Reads ROSMonitoring's YAML configurations, in the dialects of all its versions."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

import yaml

from oracle_server.core.errors import OracleError, one_line
from oracle_server.core.kinds import OF_ACTIONS, Kind
from oracle_server.specfiles.model import ros_type

_KNOWN = {
    "monitor": {"id", "oracle", "topics", "services", "actions", "ordered_topics", "ordered_services",
                "ordered_actions", "log", "silent", "warning", "status"},
    "interface": {"name", "type", "action", "publishers", "subscribers", "side", "ordered", "ordering", "warning",
                  "event_kind", "event_kinds"},
    "oracle": {"url", "port", "action", "timeout"},
}  # fmt: skip

_OF_EVENTS: Mapping[str, Kind] = {
    "start_action_request": "goal",
    "start_action_response": "reply",
    "feedback": "feedback",
    "cancel_action_request": "cancel",
    "get_result_response": "result",
    "status": "status",
}
"""The kinds of ROSMonitoring's `event_kind`."""
_NO_EVENTS = frozenset({"cancel_action_response", "get_result_request"})
"""The kinds that it has beside them, which are no events here."""
_KINDS: Mapping[Literal["topic", "service", "action"], str] = {"topic": "msg", "service": "srv", "action": "action"}
"""The kinds of interfaces, and of their types."""


class ConfigError(OracleError):
    """A configuration or property module of ROSMonitoring's that can't be read."""


@dataclass(slots=True)
class Interface:
    """A topic, a service, or an action of which `events` are observed.

    `delay` is its `max_delay_ms`, `stamp` the field that it is ordered by.
    `bare`: its name is written without the leading slash, and sent so to its oracle.
    """

    name: str
    kind: Literal["topic", "service", "action"]
    type: str
    filtered: bool
    subscribers: bool = False
    reordered: bool = False
    delay: int | None = None
    stamp: str | None = None
    bare: bool = False
    events: tuple[str, ...] = ()
    lost: list[str] = field(default_factory=list)
    """Settings that have no counterpart, as text."""

    @property
    def observed(self) -> tuple[Kind, ...]:
        """The kinds of an action's events that are observed: those that it names, or all but its status."""
        named = {_OF_EVENTS[word] for word in self.events if word in _OF_EVENTS}
        return tuple(kind for kind in OF_ACTIONS if (kind in named if named else kind != "status"))


@dataclass(slots=True)
class Oracle:
    """The oracle of a monitor: its address, how long a reply is waited for (s), what it is told and what it filters."""

    monitor: str
    url: str
    timeout: float
    told: list[Interface] = field(default_factory=list)
    filters: list[Interface] = field(default_factory=list)


@dataclass(slots=True)
class Config:
    """All monitors of a file, and the oracles of those that have one: the others only log."""

    name: str
    interfaces: list[Interface] = field(default_factory=list)
    oracles: list[Oracle] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)

    @property
    def timeout(self) -> float:
        """The longest that a reply of an oracle is waited for (s)."""
        return max((oracle.timeout for oracle in self.oracles), default=2.0)

    @property
    def reordered(self) -> bool:
        """Whether any interface was put in order of publication."""
        return any(i.reordered for i in self.interfaces)


def load_config(path: Path) -> Config:
    """Read a configuration from its file. Raises `ConfigError`."""
    try:
        loader = yaml.SafeLoader(path.read_bytes())
        root = loader.get_single_node()
        twice = next(_twice(root, set()), None)  # before `<<` is put in place
        value = None if root is None else loader.construct_document(root)
    except OSError as error:
        raise ConfigError(f"{path}: can't be read: {error.strerror}") from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise ConfigError(f"{path}: not YAML: {one_line(' '.join(str(error).split()))}") from None
    if twice is not None:
        line = twice.start_mark.line + 1
        raise ConfigError(f"{path}: line {line}: `{twice.value}` stands twice in one mapping; put both into one")
    return read_config(value, str(path))


def _twice(node: yaml.Node | None, seen: set[yaml.Node]) -> Iterator[yaml.ScalarNode]:
    """The keys that stand twice in a mapping, the first of which YAML forgets; those of `nodes` are not read."""
    if node in seen:  # by an alias
        return
    if isinstance(node, yaml.SequenceNode):
        seen.add(node)
        for item in node.value:
            yield from _twice(item, seen)
    elif isinstance(node, yaml.MappingNode):
        seen.add(node)
        keys = set()
        for key, value in node.value:
            if (key.tag, str(key.value)) in keys:
                yield key
            keys.add((key.tag, str(key.value)))
            if key.value != "nodes":
                yield from _twice(value, seen)


def read_config(value: object, file: str) -> Config:
    """Read a configuration from the value of its YAML. Raises `ConfigError`."""
    monitors = value.get("monitors") if isinstance(value, Mapping) else None
    if not isinstance(monitors, list) or not monitors:
        raise ConfigError(f"{file}: not a configuration of ROSMonitoring: the list `monitors` is missing")
    config = Config("imported")
    assert isinstance(value, Mapping)  # noqa: S101 -- it has monitors
    config.lost += [f"`{key}`: nodes are started by your own launch files" for key in ("path", "nodes") if key in value]
    for number, item in enumerate(monitors):
        monitor = item.get("monitor", item) if isinstance(item, Mapping) else None
        if not isinstance(monitor, Mapping):
            raise ConfigError(f"{file}: monitors[{number}] is not a mapping")
        name = str(monitor.get("id") or f"monitor_{number}")
        config.name = name if number == 0 else config.name
        _add_monitor(config, monitor, name, file)
    if not config.interfaces:
        raise ConfigError(f"{file}: has no topics, services or actions")
    return config


def _add_monitor(config: Config, monitor: Mapping[str, Any], name: str, file: str) -> None:
    given, place = monitor.get("oracle"), f"{file}: the oracle of monitor '{name}'"
    oracle = {} if given is None else given
    if not isinstance(oracle, Mapping):
        raise ConfigError(f"{place} is no mapping; write `oracle: {{url: 127.0.0.1, port: 8080}}`")
    judge = Oracle(name, _address(oracle, place), _timeout(oracle, place))
    reasons = {
        "log": "the server keeps the history, and `oracle-server record` writes it to a file",
        "silent": "the server has a log of its own",
        "warning": "every outcome is recorded; select those that you need",
        "status": "see the adapter's own diagnostics",
    }
    config.lost += [f"`{key}` of monitor '{name}': {reasons[key]}" for key in reasons if key in monitor]
    if oracle.get("action") not in (None, "nothing"):
        config.lost.append(f"`oracle.action: {oracle['action']}` of monitor '{name}': messages are never changed here")
    config.lost += [f"`{key}` of monitor '{name}'" for key in _others(monitor, "monitor")]
    config.lost += [f"`oracle.{key}` of monitor '{name}'" for key in _others(oracle, "oracle")]
    for kind in _KINDS:
        listed = [_interface(item, kind, name, file) for item in _items(monitor, kind, name, file)]
        ordered = _ordered(monitor, kind, name, file)
        for interface in listed:
            interface.reordered = interface.reordered or interface.name in ordered
            known = next((i for i in config.interfaces if (i.name, i.kind) == (interface.name, kind)), None)
            if interface.filtered:
                judge.filters.append(known or interface)
            if known is None:
                config.interfaces.append(interface)
            else:
                _merge(known, interface, name, file)
            judge.told.append(known or interface)
        unknown = sorted(ordered - {interface.name for interface in listed})
        config.lost += [f"`ordered_{kind}s` of monitor '{name}': {n} is none of its {kind}s" for n in unknown]
    if given is not None and judge.told:
        config.oracles.append(judge)


def _address(oracle: Mapping[str, Any], place: str) -> str:
    """The address of an oracle, with the scheme and the port that its `url` has, if any. Raises `ConfigError`."""
    url, port = str(oracle.get("url") or "127.0.0.1"), oracle.get("port")
    port = 8080 if port is None else port
    if isinstance(port, bool) or not re.fullmatch(r"[0-9]{1,5}", str(port)) or not 0 < int(port) < 2**16:
        raise ConfigError(f"{place}: `port: {port}` is no number from 1 to 65535")
    try:
        parts = urlsplit(url if "://" in url else f"ws://{url}")
        own = parts.port
    except ValueError as error:
        raise ConfigError(f"{place}: `url: {url}` can't be read: {error}") from None
    host = parts.netloc if own is not None else f"{parts.netloc.removesuffix(':')}:{port}"
    return parts._replace(netloc=host).geturl()


def _timeout(oracle: Mapping[str, Any], place: str) -> float:
    found = oracle.get("timeout")
    if found is None:
        return 2.0
    try:
        seconds = float(found)
    except (TypeError, ValueError, OverflowError):
        seconds = math.nan
    if isinstance(found, bool) or not 0 < seconds < math.inf:
        raise ConfigError(f"{place}: `timeout: {found}` is no number of seconds greater than 0; write `timeout: 2`")
    return seconds


def _merge(known: Interface, other: Interface, monitor: str, file: str) -> None:
    """Add what a monitor says of an interface to what is known of it. Raises `ConfigError` where types contradict."""
    types = [ros_type(i.type, _KINDS[i.kind]) for i in (known, other) if i.type]
    if len(set(types)) > 1:
        raise ConfigError(
            f"{file}: {known.kind} {known.name} of monitor '{monitor}' has the type {types[1]}, and {types[0]} before; "
            "one interface has one type"
        )
    if known.filtered and other.filtered and known.subscribers != other.subscribers:
        known.lost.append(
            f"filtered by monitor '{monitor}' for its {'subscribers' if other.subscribers else 'publishers'}, too"
        )
    elif other.filtered and not known.filtered:
        known.subscribers = other.subscribers
    if known.stamp and other.stamp and known.stamp != other.stamp:
        known.lost.append(f"ordered by `{other.stamp}` in monitor '{monitor}'")
    known.type, known.stamp = known.type or other.type, known.stamp or other.stamp
    known.filtered, known.reordered = known.filtered or other.filtered, known.reordered or other.reordered
    known.delay = max((i.delay for i in (known, other) if i.delay is not None), default=None)
    known.events = known.events + other.events if known.events and other.events else ()
    known.lost += [text for text in other.lost if text not in known.lost]


def _items(monitor: Mapping[str, Any], kind: str, name: str, file: str) -> Iterator[Mapping[str, Any]]:
    """The interfaces of a kind: those listed, and those described in the list of ordered ones. Raises `ConfigError`."""
    for number, item in enumerate(_section(monitor, f"{kind}s", name, file)):
        if not isinstance(item, Mapping):
            raise ConfigError(
                f"{file}: {kind}s[{number}] of monitor '{name}' is {item!r}; write what it is, as in "
                f"`{{name: /x, type: …, action: log}}`"
            )
        yield item
    for item in _section(monitor, f"ordered_{kind}s", name, file):
        if isinstance(item, Mapping) and "type" in item:
            yield item


def _section(monitor: Mapping[str, Any], key: str, name: str, file: str) -> list[object]:
    found = monitor.get(key)
    if found is not None and not isinstance(found, list):
        raise ConfigError(f"{file}: `{key}` of monitor '{name}' is no list; begin each item with `- `")
    return found or []


def _ordered(monitor: Mapping[str, Any], kind: str, name: str, file: str) -> set[str]:
    """The names of the interfaces of a kind that are put in order. Raises `ConfigError`."""
    names = set()
    for number, item in enumerate(_section(monitor, f"ordered_{kind}s", name, file)):
        found = item.get("name") if isinstance(item, Mapping) else item
        if not isinstance(found, str):
            raise ConfigError(f"{file}: ordered_{kind}s[{number}] of monitor '{name}' has no name: {item!r}")
        names.add(_slashed(found))
    return names


def _interface(
    item: Mapping[str, Any], kind: Literal["topic", "service", "action"], monitor: str, file: str
) -> Interface:
    name = item.get("name")
    if not isinstance(name, str) or not re.fullmatch(r"[~/A-Za-z][\w/~]*", name):
        raise ConfigError(
            f"{file}: a {kind} of monitor '{monitor}' has no name, or one that ROS does not allow: {name!r}"
        )
    place = f"{file}: {kind} {name} of monitor '{monitor}'"
    action, ordering = item.get("action") or "log", _ordering(item, place)
    if action not in ("log", "filter"):
        raise ConfigError(f"{place}: `action: {action}` is neither `log` nor `filter`")
    by = ordering.get("order_by", ordering.get("source"))
    found = Interface(
        name=_slashed(name),
        kind=kind,
        type=_type(item.get("type"), kind, place),
        filtered=action == "filter",
        subscribers="subscribers" in item or item.get("side") == "subscribers",
        reordered=bool(ordering.get("enabled", bool(ordering))),
        delay=ordering.get("max_delay_ms") if isinstance(ordering.get("max_delay_ms"), int) else None,
        stamp=by if isinstance(by, str) and re.fullmatch(r"\w+(\.\w+)+", by) else None,
        bare=_slashed(name) != name,
        events=_words(item.get("event_kinds", item.get("event_kind"))),
    )
    found.lost += _lost(item, found, ordering)
    return found


def _type(value: object, kind: Literal["topic", "service", "action"], place: str) -> str:
    """A type as it is written, of two or three parts; empty where there is none. Raises `ConfigError`."""
    found = "" if value is None else value
    if not isinstance(found, str) or not re.fullmatch(r"\s*(\w+[./]\w+([./]\w+)?)?\s*", found):
        raise ConfigError(
            f"{place}: `type: {found}` is no name of a type; write its package, too, as in "
            f"`package.{_KINDS[kind]}.Type`"
        )
    return found.strip()


def _ordering(item: Mapping[str, Any], place: str) -> Mapping[str, Any]:
    found = item.get("ordering")
    if isinstance(found, bool | None):
        return {}
    if not isinstance(found, Mapping):
        raise ConfigError(f"{place}: `ordering` is no mapping; write `ordering: {{enabled: true, max_delay_ms: …}}`")
    return found


def _lost(item: Mapping[str, Any], interface: Interface, ordering: Mapping[str, Any]) -> Iterator[str]:
    """What an interface's item says that has no counterpart."""
    if (item.get("ordered") or item.get("ordering") is True) and not interface.reordered:
        yield f"`{'ordered' if item.get('ordered') else 'ordering'}: true` alone put nothing in order there"
    if ordering.get("max_delay_ms") != interface.delay:
        yield f"`max_delay_ms: {ordering['max_delay_ms']}`, which is no whole number"
    by = ordering.get("order_by", ordering.get("source"))
    if by is not None and interface.stamp is None:
        yield f"ordered by `{by}`"
    if interface.filtered and interface.kind == "topic" and not {"publishers", "subscribers", "side"} & item.keys():
        yield "without `publishers` or `subscribers` its filter did nothing there; here it does"
    yield from (f"`{key}`" for key in _others(item, "interface"))
    for word in interface.events:
        if word not in _OF_EVENTS and word not in _NO_EVENTS:
            yield f"`event_kind: {word}`, which is no kind of an action's events"
    if "warning" in item:
        yield "`warning`: every outcome is recorded; with 2, `currently_false` passed a filter in version 1"


def _others(found: Mapping[Any, Any], what: str) -> list[str]:
    return sorted(str(key) for key in found if key not in _KNOWN[what])


def _words(value: object) -> tuple[str, ...]:
    found = value if isinstance(value, list) else [value]
    return tuple(str(word) for word in found if word is not None)


def _slashed(name: str) -> str:
    return name if name.startswith(("/", "~")) else f"/{name}"
