"""The command `import`: writes a spec from ROSMonitoring's files, with comments where there is no counterpart."""

from __future__ import annotations

import json
import re
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from oracle_server.core.errors import ExpressionError, FormulaError, one_line
from oracle_server.core.expressions import parse_expression
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.kinds import RESERVED
from oracle_server.specfiles.rosmonitoring.config import Config, ConfigError, Interface, read_config
from oracle_server.specfiles.rosmonitoring.module import PropertyModule, read_module
from oracle_server.specfiles.rosmonitoring.predicates import Stream, effect

STUB = "1 / 0 == 1"
"""A signal that always fails, so that formulas with it are unknown until it is written."""
_IGNORED = RESERVED | {"time", "t"}


@dataclass(slots=True)
class _Signals:
    """One stream's signals: their CEL, those that hold their value, and the Python that can't be translated."""

    cel: dict[str, str] = field(default_factory=dict)
    hold: list[str] = field(default_factory=list)
    unread: dict[str, str] = field(default_factory=dict)


def import_config(config: Path, modules: Sequence[Path], out: Path | None) -> None:
    """Write the spec of a configuration, or print it. Raises `ConfigError`."""
    try:
        value = yaml.safe_load(config.read_bytes())
    except OSError as error:
        raise ConfigError(f"{config}: can't be read: {error.strerror}") from None
    except (yaml.YAMLError, RecursionError) as error:
        raise ConfigError(f"{config}: not YAML: {one_line(' '.join(str(error).split()))}") from None
    text = spec_text(read_config(value, str(config)), [read_module(path) for path in modules], config.name)
    if out is None:
        sys.stdout.write(text)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{out}: can't be written: {error.strerror}") from None


def spec_text(config: Config, modules: Sequence[PropertyModule], source: str) -> str:
    """The text of the spec for a configuration and its modules."""
    signals = {(i.name, kind): _signals(i, kind, modules) for i in config.interfaces for kind in _kinds(i)}
    shared = _hold(signals)
    lines = [f"# Imported from {source} by `oracle-server import`. Check the lines marked TODO."]
    lines += [f"# no counterpart: {one_line(text)}" for text in config.lost]
    lines += [f"# TODO: `{name}` kept its value over several streams' messages there; here only one stream can hold it"
              for name in shared]  # fmt: skip
    lines += [f"id: {re.sub(r'[^A-Za-z0-9_.-]', '_', config.name)[:64]}", *_ordering(config), "streams:"]
    wait = 0 if modules else _milliseconds(config.timeout)
    for interface in config.interfaces:
        lines += _interface(config, interface, signals, wait)
    lines += ["properties:", *_properties(config, modules, signals)]
    return "\n".join(lines) + "\n"


def _kinds(interface: Interface) -> tuple[str, ...]:
    return ("topic",) if interface.kind == "topic" else ("request", "response")


def _signals(interface: Interface, kind: str, modules: Sequence[PropertyModule]) -> _Signals:
    found = _Signals()
    for module in modules:
        if module.function is None:
            continue
        done = effect(module.function, Stream(interface.kind, interface.name, kind))
        found.unread |= {n: python for n, python in done.unread.items() if n not in _IGNORED}
        for name, cel in done.assigned.items():
            if name in _IGNORED or name in found.unread:
                continue
            if _reads(cel):
                found.cel[name] = cel
            else:
                found.unread[name] = cel
    return found


def _reads(cel: str) -> bool:
    try:
        parse_expression(cel)
    except ExpressionError:
        return False
    return True


def _hold(signals: dict[tuple[str, str], _Signals]) -> list[str]:
    """Hold the signals that only one stream sets; returns those that several streams, but not all, set."""
    setters: defaultdict[str, list[_Signals]] = defaultdict(list)
    for stream in signals.values():
        for name in (*stream.cel, *stream.unread):
            setters[name].append(stream)
    shared = []
    for name, streams in setters.items():
        if len(streams) == len(signals):
            continue
        if len(streams) == 1:
            streams[0].hold.append(name)
        else:
            shared.append(name)
    return sorted(shared)


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


def _interface(config: Config, interface: Interface, signals: dict[tuple[str, str], _Signals], wait: int) -> list[str]:
    """The lines of one interface; `wait` is how long (ms) decisions wait for an external oracle."""
    lines = [f"  - {interface.kind}: {interface.name}"]
    if interface.type:
        lines.append(f"    type: {interface.type}")
    lines += [f"    # no counterpart: {one_line(text)}" for text in interface.lost]
    if config.reordered and not interface.reordered:
        lines.append("    ordered: false")
    if interface.filtered:
        least = max([i.delay or 200 for i in config.interfaces if i.reordered], default=0)
        within = max(_milliseconds(config.timeout), least + wait + 100)
        lines += ["    action: filter", f"    decide_within: {within}ms"]
        lines.append("    on_unavailable: deny   # ROSMonitoring's filters pass all while the oracle is unreachable")
        if interface.kind == "topic":
            lines.append(f"    intercept: {'subscriber' if interface.subscribers else 'publisher'}")
    if interface.kind == "topic":
        return lines + _channel(interface, signals[interface.name, "topic"], "    ")
    for kind in _kinds(interface):
        inside = _channel(interface, signals[interface.name, kind], "      ")
        lines += [f"    {kind}:", *inside] if inside else []
    return lines


def _milliseconds(seconds: float) -> int:
    return max(1, round(seconds * 1000))


def _channel(interface: Interface, signals: _Signals, indent: str) -> list[str]:
    lines = [f"{indent}stamp: {interface.stamp}"] if interface.stamp else []
    if signals.hold:
        lines.append(f"{indent}hold: [{', '.join(signals.hold)}]")
    if signals.cel or signals.unread:
        lines.append(f"{indent}signals:")
    for name, cel in signals.cel.items():
        lines.append(f"{indent}  {json.dumps(name)}: {json.dumps(cel)}")
    for name, python in signals.unread.items():
        was = [f"{indent}  # {line}" for line in python.splitlines()]
        lines += [f"{indent}  # TODO: write this as CEL over `msg`; until then its formulas are unknown. It was:", *was]
        lines.append(f"{indent}  {json.dumps(name)}: {json.dumps(STUB)}")
    return lines


def _properties(
    config: Config, modules: Sequence[PropertyModule], signals: dict[tuple[str, str], _Signals]
) -> list[str]:
    guards = f"    guards: [{', '.join(i.name for i in config.interfaces if i.filtered)}]"
    lines: list[str] = []
    if not modules:
        lines += [
            "  # No property module was given (--properties), so that the external oracle still judges.",
            "  - id: oracle",
            "    engine: external",
            f"    url: {config.url}",
            f"    timeout: {_milliseconds(config.timeout)}ms",
        ]
        lines += ["    names: bare   # as it received them before"] if all(i.bare for i in config.interfaces) else []
        lines += [guards] if any(i.filtered for i in config.interfaces) else []
        return lines
    known = {name for stream in signals.values() for name in (*stream.cel, *stream.unread)}
    for module in modules:
        formula = _formula(module, config)
        lines.append(f"  - id: {module.name}")
        lines += [f"    # TODO: {text}" for text in _doubts(module, formula, known)]
        lines.append(f"    formula: {json.dumps(formula if _parses(formula) is None else '{todo}')}")
        lines += [guards] if any(i.filtered for i in config.interfaces) else []
    return lines


def _formula(module: PropertyModule, config: Config) -> str:
    text = module.formula
    for name in module.truths:
        text = re.sub(rf"(\b{re.escape(name)}\s*:\s*)(True|False)\b", lambda m: m[1] + m[2].lower(), text)
    for interface in config.interfaces:
        bare = re.escape(interface.name.removeprefix("/"))
        text = re.sub(rf'({interface.kind}\s*:\s*)(["\']?)/?{bare}\2(?=\s*[,}}])', rf'\1"{interface.name}"', text)
    return text


def _parses(formula: str) -> str | None:
    try:
        parse_formula(formula, "steps")
    except FormulaError as error:
        return str(error)
    return None


def _doubts(module: PropertyModule, formula: str, known: set[str]) -> list[str]:
    wrong = _parses(formula)
    if wrong is not None:
        return [f"the formula can't be read ({one_line(wrong)}); it was: {one_line(module.formula)}"]
    doubts = []
    if "[" in formula:
        doubts.append("bounds count steps here; with `time: seconds`, as in the oracle's dense mode, they are seconds")
    initial = sorted(
        n for n, v in module.initial.items() if v not in (None, False) and n in known and n not in _IGNORED
    )
    if initial:
        doubts.append(f"before its first message {', '.join(initial)} had a value there, and is absent here")
    lost = sorted(n for n in module.initial if n not in known and n not in _IGNORED and re.search(rf"\b{n}\b", formula))
    if lost:
        doubts.append(f"no stream sets {', '.join(lost)}")
    return doubts
