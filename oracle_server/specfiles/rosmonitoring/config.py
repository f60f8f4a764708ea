"""Reads ROSMonitoring's YAML configurations, in the dialects of all its versions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from oracle_server.core.errors import OracleError
from oracle_server.core.kinds import OF_ACTIONS, Kind

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
"""The kinds of ROSMonitoring's `event_kind`; what it has beside them is no event here."""
_KINDS: tuple[Literal["topic", "service", "action"], ...] = ("topic", "service", "action")


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
class Config:
    """All monitors of a file; `url` is the address of the first one's oracle, `timeout` that of its replies (s)."""

    name: str
    interfaces: list[Interface] = field(default_factory=list)
    url: str = "ws://127.0.0.1:8080"
    timeout: float = 2.0
    lost: list[str] = field(default_factory=list)

    @property
    def reordered(self) -> bool:
        """Whether any interface was put in order of publication."""
        return any(i.reordered for i in self.interfaces)


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
        name = str(monitor.get("id", f"monitor_{number}"))
        config.name = name if number == 0 else config.name
        _add_monitor(config, monitor, name, file, first=number == 0)
    if not config.interfaces:
        raise ConfigError(f"{file}: has no topics, services or actions")
    return config


def _add_monitor(config: Config, monitor: Mapping[str, Any], name: str, file: str, *, first: bool) -> None:
    oracle = monitor.get("oracle") if isinstance(monitor.get("oracle"), Mapping) else {}
    assert isinstance(oracle, Mapping)  # noqa: S101 -- the line above
    if first:
        config.url = f"ws://{oracle.get('url', '127.0.0.1')}:{oracle.get('port', 8080)}"
        config.timeout = float(oracle.get("timeout") or 2.0)
    elif oracle:
        config.lost.append(f"the oracle of monitor '{name}': one spec has one oracle here; import it by itself")
    reasons = {
        "log": "the server keeps the history, and `oracle-server record` writes it to a file",
        "silent": "the server has a log of its own",
        "warning": "every outcome is recorded; select those that you need",
        "status": "see the adapter's own diagnostics",
    }
    config.lost += [f"`{key}` of monitor '{name}': {reasons[key]}" for key in reasons if key in monitor]
    if oracle.get("action") not in (None, "nothing"):
        config.lost.append(f"`oracle.action: {oracle['action']}` of monitor '{name}': messages are never changed here")
    config.lost += [f"`{key}` of monitor '{name}'" for key in sorted(set(monitor) - _KNOWN["monitor"])]
    config.lost += [f"`oracle.{key}` of monitor '{name}'" for key in sorted(set(oracle) - _KNOWN["oracle"])]
    ordered = {kind: _names(monitor.get(f"ordered_{kind}s")) for kind in _KINDS}
    for kind in _KINDS:
        for item in _items(monitor, kind):
            interface = _interface(item, kind, name, file)
            interface.reordered = interface.reordered or interface.name in ordered[kind]
            known = next((i for i in config.interfaces if (i.name, i.kind) == (interface.name, kind)), None)
            if known is None:
                config.interfaces.append(interface)
            else:
                known.filtered = known.filtered or interface.filtered
                known.reordered = known.reordered or interface.reordered


def _items(monitor: Mapping[str, Any], kind: str) -> Iterator[Mapping[str, Any]]:
    """The interfaces of a kind: those listed, and those described only in the list of ordered ones."""
    seen = set()
    for key in (f"{kind}s", f"ordered_{kind}s"):
        for item in monitor.get(key) or ():
            if isinstance(item, Mapping) and item.get("name") not in seen and (key == f"{kind}s" or "type" in item):
                seen.add(item.get("name"))
                yield item


def _names(items: object) -> set[str]:
    found = items if isinstance(items, list) else []
    return {_slashed(str(i.get("name") if isinstance(i, Mapping) else i)) for i in found}


def _interface(
    item: Mapping[str, Any], kind: Literal["topic", "service", "action"], monitor: str, file: str
) -> Interface:
    name = item.get("name")
    if not isinstance(name, str) or not re.fullmatch(r"[~/A-Za-z][\w/~]*", name):
        raise ConfigError(
            f"{file}: a {kind} of monitor '{monitor}' has no name, or one that ROS does not allow: {name!r}"
        )
    ordering = item.get("ordering") if isinstance(item.get("ordering"), Mapping) else {}
    assert isinstance(ordering, Mapping)  # noqa: S101 -- the line above
    by = ordering.get("order_by", ordering.get("source"))
    found = Interface(
        name=_slashed(name),
        kind=kind,
        type=str(item.get("type", "")),
        filtered=item.get("action") == "filter",
        subscribers="subscribers" in item or item.get("side") == "subscribers",
        reordered=bool(ordering.get("enabled", bool(ordering))),
        delay=ordering.get("max_delay_ms") if isinstance(ordering.get("max_delay_ms"), int) else None,
        stamp=by if isinstance(by, str) and re.fullmatch(r"\w+(\.\w+)+", by) else None,
        bare=_slashed(name) != name,
        events=_words(item.get("event_kinds", item.get("event_kind"))),
    )
    if item.get("ordered") and not found.reordered:
        found.lost.append("`ordered: true` alone put nothing in order there")
    if by is not None and found.stamp is None:
        found.lost.append(f"ordered by `{by}`")
    if found.filtered and kind == "topic" and not {"publishers", "subscribers", "side"} & item.keys():
        found.lost.append("without `publishers` or `subscribers` its filter did nothing there; here it does")
    found.lost += [f"`{key}`" for key in sorted(set(item) - _KNOWN["interface"])]
    if "warning" in item:
        found.lost.append(
            "`warning`: every outcome is recorded; with 2, `currently_false` passed a filter in version 1"
        )
    return found


def _words(value: object) -> tuple[str, ...]:
    found = value if isinstance(value, list) else [value]
    return tuple(word for word in found if isinstance(word, str))


def _slashed(name: str) -> str:
    return name if name.startswith(("/", "~")) else f"/{name}"
