"""The command `import`: writes a spec from ROSMonitoring's files, with comments where there is no counterpart."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from oracle_server.core.errors import one_line
from oracle_server.core.formula.tree import Historically, Once, Since, walk
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.imported import Imported, write_spec
from oracle_server.specfiles.rosmonitoring.actions import action_lines, action_of, lost_of
from oracle_server.specfiles.rosmonitoring.cel import FAILS
from oracle_server.specfiles.rosmonitoring.cel import TODO as UNWRITTEN
from oracle_server.specfiles.rosmonitoring.config import Config, ConfigError, Interface, Oracle, load_config
from oracle_server.specfiles.rosmonitoring.draft import TODO, Draft, make_draft, streams_of
from oracle_server.specfiles.rosmonitoring.module import read_module
from oracle_server.specfiles.rosmonitoring.streams import Stream
from oracle_server.specfiles.rosmonitoring.translate import Translation, reason_line

_BOUNDS = (
    "the bounds of {} count events, as with an oracle's --discrete; where it ran with --dense they were seconds: say "
    "`time: seconds` there, and look at what differs (docs/from-rosmonitoring.md)"
)


def import_config(config: Path, modules: Sequence[Path], out: Path | None, types: Types) -> Imported:
    """Write the spec of a configuration, or print it, and check it. Raises `ConfigError`, `NotWrittenError`."""
    if config.suffix == ".py":
        raise ConfigError(
            f"{config}: Python, and no configuration (.yaml): a property module is given by --properties, as in "
            f"`oracle-server import CONFIG --properties {config.name}`"
        )
    read = load_config(config)
    draft = make_draft(read, [read_module(path) for path in modules], types)
    text = spec_text(read, draft, config.name)
    findings = write_spec(text, out, types)
    counting = [module.name for module, found in draft.properties if found is not None and _is_bounded(found)]
    notes = (_BOUNDS.format(", ".join(counting)),) if counting else ()
    return Imported(tuple(todos(draft)), tuple(draft.failing), findings, judges=draft.judges, notes=notes)


def todos(draft: Draft) -> list[str]:
    """The predicates, and the properties whose formulas, are to be written."""
    return [*draft.unread, *(f"the formula of {name}" for name in draft.unjudged)]


def spec_text(config: Config, draft: Draft, source: str) -> str:
    """The text of the spec for a configuration and what its modules became."""
    lines = [f"# Imported from {source} by `oracle-server import`. Check the lines marked TODO."]
    actions = _actions(config)
    lost = [*config.lost, *(text for parts in actions.values() for text in lost_of(parts, draft))]
    lines += [f"# no counterpart: {one_line(text)}" for text in lost]
    lines += [f"id: {_id(config.name)}", *_ordering(config), "streams:"]
    external = draft.oracles and (not draft.properties or any(found is None for _, found in draft.properties))
    wait = _milliseconds(config.timeout) if external else 0
    for interface in config.interfaces:
        parts = actions.get(action_of(interface))
        if parts is None:
            lines += _interface(config, interface, draft, wait)
        elif interface is parts[0]:
            lines += action_lines(parts, draft, _action_keys(config, parts, wait))
    lines += ["properties:", *_properties(config, draft)]
    return "\n".join(lines) + "\n"


def _ordering(config: Config) -> list[str]:
    if not config.reordered:
        return [
            "ordering:",
            "  by: arrival   # as in ROSMonitoring; `publication` is better where messages have stamps",
        ]
    delays = [i.delay for i in config.interfaces if i.reordered and i.delay]
    if delays:
        return ["ordering:", "  by: publication", f"  max_delay: {max(delays)}ms"]
    return [
        "ordering:",
        "  by: publication",
        "  max_delay: 200ms   # ROSMonitoring waits without limit for the rarest stream",
    ]


def _interface(config: Config, interface: Interface, draft: Draft, wait: int) -> list[str]:
    """The lines of one interface; `wait` is how long (ms) decisions wait for an external oracle."""
    lines = [f"  - {interface.kind}: {interface.name}"]
    if interface.type:
        lines.append(f"    type: {interface.type}")
    lines += [f"    # no counterpart: {one_line(text)}" for text in interface.lost]
    if config.reordered and not interface.reordered:
        lines.append("    ordered: false")
    if interface.filtered:
        lines += ["    action: filter", *_deciding(config, wait)]
        if interface.kind == "topic":
            lines.append(f"    intercept: {'subscriber' if interface.subscribers else 'publisher'}")
    for stream in streams_of(interface):
        if stream.kind == "topic":
            lines += _channel(interface, stream, draft, "    ")
        else:
            inside = _channel(interface, stream, draft, "      ")
            lines += [f"    {stream.kind}:", *inside] if inside else []
    return lines


def _actions(config: Config) -> dict[str, list[Interface]]:
    """The interfaces of each action."""
    found: dict[str, list[Interface]] = {}
    for interface in config.interfaces:
        if action_of(interface):
            found.setdefault(action_of(interface), []).append(interface)
    return found


def _action_keys(config: Config, parts: Sequence[Interface], wait: int) -> list[str]:
    lines = [f"    # no counterpart: {one_line(text)}" for part in parts for text in part.lost]
    if config.reordered and not any(part.reordered for part in parts):
        lines.append("    ordered: false")
    return lines + (_deciding(config, wait) if any(part.filtered for part in parts) else [])


def _deciding(config: Config, wait: int) -> list[str]:
    """How long is waited for decisions, and what becomes of events without."""
    least = max([i.delay or 200 for i in config.interfaces if i.reordered], default=0)
    within = max(_milliseconds(config.timeout), least + wait + 100)
    unavailable = "    on_unavailable: deny   # ROSMonitoring's filters pass all while the oracle is unreachable"
    return [f"    decide_within: {within}ms", unavailable]


def _milliseconds(seconds: float) -> int:
    return max(1, round(seconds * 1000))


def _channel(interface: Interface, stream: Stream, draft: Draft, indent: str) -> list[str]:
    lines = [f"{indent}stamp: {interface.stamp}"] if interface.stamp else []
    hold = [name for name, signal in draft.signals.items() if signal.hold == stream]
    if hold:
        lines.append(f"{indent}hold: [{', '.join(json.dumps(name) for name in hold)}]")
    inside = [line for name in draft.signals for line in _signal(name, stream, draft, f"{indent}  ")]
    if inside:
        lines += [f"{indent}signals:", *inside]
    elif draft.properties:
        lines.append(f"{indent}signals: {{}}   # its messages set nothing that a formula reads")
    return lines


def _signal(name: str, stream: Stream, draft: Draft, indent: str) -> list[str]:
    signal = draft.signals[name]
    if stream in signal.cel:
        cel = signal.cel[stream]
        fails = [f"{indent}# the module fails here, so that its formulas are unknown"] if cel == FAILS else []
        return [*fails, f"{indent}{json.dumps(name)}: {json.dumps(cel)}"]
    if stream not in signal.unread:
        return []
    was = signal.unread[stream]
    lines = [f"{indent}# unknown here too, until `{name}` is written" if not was and name != TODO else ""]
    if was:
        lines = [f"{indent}# TODO: write this as CEL over `msg`; until then its formulas are unknown. It was:"]
        lines += [f"{indent}# {line}" for line in was.splitlines()]
    return [*(line for line in lines if line), f"{indent}{json.dumps(name)}: {json.dumps(UNWRITTEN)}"]


def _properties(config: Config, draft: Draft) -> list[str]:
    if not draft.properties and not config.oracles:
        why = "  # TODO: no monitor has an `oracle`, so that nothing was judged: write here what must hold."
        return [why, f"  - id: {TODO}", f'    formula: "{{{TODO}}}"', *_filtered(config)]
    if not draft.properties:
        lines = ["  # No property module was given (--properties), so that the external oracle still judges."]
        return lines + _oracles(config, "oracle")
    lines = []
    for module, found in draft.properties:
        if found is None:
            lines += [
                "  # Its formula is about what comes, so that its oracle still judges. It was:",
                f"  # {one_line(module.formula)}",
                *_oracles(config, module.name),
            ]
            continue
        lines.append(f"  - id: {module.name}")
        lines += [f"    # {text}" for text in _remarks(found)]
        if found.text is None:
            lines.append(f"    # TODO: {reason_line(found)}")
        lines.append(f"    formula: {json.dumps(found.text or '{' + TODO + '}', ensure_ascii=False)}")
        lines += _filtered(config)
        if lines[-1].startswith("    guards:"):
            lines.append("    blame: any   # as in ROSMonitoring; `caused` denies only what withholding mends")
    return lines


def _oracles(config: Config, name: str) -> list[str]:
    """The oracles that judge: one by `name`, of several each by its monitor's, too."""
    if len(config.oracles) == 1:
        return _oracle(config, config.oracles[0], name)
    return [line for one in config.oracles for line in _oracle(config, one, _id(f"{name}_{one.monitor}"))]


def _oracle(config: Config, oracle: Oracle, name: str) -> list[str]:
    """The property that an oracle judges: it is told of the interfaces of its own monitor alone."""
    lines = [
        f"  - id: {name}",
        "    engine: external",
        f"    url: {oracle.url}",
        f"    timeout: {_milliseconds(oracle.timeout)}ms",
    ]
    told = _names(oracle.told)
    lines += [f"    streams: [{', '.join(told)}]"] if told != _names(config.interfaces) else []
    lines += ["    names: bare   # as it received them before"] if all(i.bare for i in oracle.told) else []
    return lines + _guards(oracle.filters)


def _filtered(config: Config) -> list[str]:
    """The guards of all that any monitor filters."""
    return _guards(interface for interface in config.interfaces if interface.filtered)


def _guards(filtered: Iterable[Interface]) -> list[str]:
    names = _names(filtered)
    return [f"    guards: [{', '.join(names)}]"] if names else []


def _names(interfaces: Iterable[Interface]) -> list[str]:
    """The names of some interfaces, each once."""
    return list(dict.fromkeys(action_of(interface) or interface.name for interface in interfaces))


def _id(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]", "_", name)[:64]


def _is_bounded(found: Translation) -> bool:
    """Whether a formula has bounds, which an oracle took for seconds with `--dense`."""
    return found.formula is not None and any(
        isinstance(node, Once | Historically | Since) and (node.bound.lower or node.bound.upper is not None)
        for node in walk(found.formula)
    )


def _remarks(found: Translation) -> list[str]:
    """What a reader of the spec is told of a formula that is judged."""
    remarks = []
    if _is_bounded(found):
        remarks.append(
            "Bounds count events here, as with the oracle's --discrete. `time: seconds` would count seconds,"
        )
        remarks.append(
            "and is not its --dense: there a message lasts until the next one, and is judged when that comes."
        )
    if "{" not in found.module.formula:
        remarks.append(f"Written from: {one_line(found.module.formula)}")
    return remarks
