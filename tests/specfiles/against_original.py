"""Imported specs compared with the original oracle, verdict for verdict, on random traffic.

By hand, on modules and configurations of your own, which are really run: `python -m tests.specfiles.against_original
MODULE.py… [--config CONFIG.yaml] [--traces 200] [--seed 1]`. It prints a line for each: how many verdicts were the
same, how many unknown, and the first trace on which they differ.
"""

from __future__ import annotations

import argparse
import ast
import json
import math
import random
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from oracle_server.core.errors import OracleError
from oracle_server.core.shapes import Many, Record, Shape, Value
from oracle_server.core.verdicts import Outcome
from oracle_server.replay.run import Replay
from oracle_server.replay.traces.jsonl import read_lines
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.rosmonitoring.config import Config, read_config
from oracle_server.specfiles.rosmonitoring.draft import make_draft, streams_of
from oracle_server.specfiles.rosmonitoring.module import read_module
from oracle_server.specfiles.rosmonitoring.write import spec_text, todos
from tests.specfiles.original import Event, judged

TYPES = Types()
_TRUE = {Outcome.TRUE, Outcome.CURRENTLY_TRUE}
_FALSE = {Outcome.FALSE, Outcome.CURRENTLY_FALSE}


@dataclass(slots=True)
class Compared:
    """How many verdicts were the same, and unknown here; `different` is the first trace with another one.

    Where the original fails, only unknown is right, or what was settled before.
    """

    same: int = 0
    unknown: int = 0
    todos: int = 0
    external: bool = False
    different: list[Event] | None = None
    text: str = ""
    values: set[bool] = field(default_factory=set)


def imported(config: Config, module: Path) -> tuple[str, int, str | None, bool]:
    """The spec's text, how many TODOs it has, the formula in reelay's words, and whether its oracle still judges."""
    read = read_module(module)
    draft = make_draft(config, [read], TYPES)
    formula = None
    if "{" not in read.formula and draft.properties[0][1] is not None:
        words = {"historically", "once", "since", "pre", "and", "or", "not", "implies"}
        plain = re.sub(r"\bG\b", "historically", read.formula)
        plain = re.sub(r"\bAND\b|&&", "and", re.sub(r"\bOR\b|\|\|", "or", re.sub(r"!\s*", "not ", plain)))
        plain = re.sub(r"historically\s+(not .*)$", r"historically(\1)", plain)
        formula = re.sub(r"[A-Za-z_]\w*", lambda m: m[0] if m[0] in words else f"{{{m[0]}}}", plain)
    return spec_text(config, draft, "config.yaml"), len(todos(draft)), formula, draft.properties[0][1] is None


def compare(config: Config, module: Path, traces: Sequence[Sequence[Event]]) -> Compared:
    """Compare what is imported with the original, on these traces."""
    text, open_, formula, external = imported(config, module)
    found = Compared(todos=open_, external=external, text=text)
    spec = parse_spec(text, "imported", types=TYPES).spec
    if external:
        return found
    originals = judged(module, traces, formula)
    for trace, original, ours in zip(traces, originals, _ours(spec, traces), strict=False):
        last = None
        for theirs, (said, degraded) in zip(original, ours, strict=False):
            settled, last = said == last and said in (Outcome.TRUE, Outcome.FALSE), said
            if theirs is None and settled:
                continue
            found.values |= set() if theirs is None else {theirs}
            if said == Outcome.UNKNOWN or degraded:
                found.unknown += 1
            elif (said in _TRUE and theirs is True) or (said in _FALSE and theirs is False):
                found.same += 1
            elif found.different is None:
                found.different = list(trace)
                found.text += f"\n# original: {original}\n# here:     {[str(o.value) for o, _ in ours]}\n"
    return found


def _ours(spec: Any, traces: Iterable[Sequence[Event]]) -> Iterator[list[tuple[Outcome, bool]]]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trace.jsonl"
        for trace in traces:
            path.write_text("".join(json.dumps(event) + "\n" for event in trace))
            steps = [j for j in Replay(spec, read_lines(path, spec), "arrival") if j.number is not None]
            yield [(j.verdicts[0].outcome, j.verdicts[0].degraded) for j in steps]


class Traffic:
    """Random flat events that a module may look at: its topics and fields, and values near its constants."""

    def __init__(
        self,
        module: Path,
        config: Config,
        chance: random.Random,
        fields: Mapping[str, str | list[str]] | None = None,
        optional: bool = True,
        odd: bool = False,
    ) -> None:
        """`fields` are kinds, or values, by name, if they are known; `optional`: a stream may lack some.

        `odd`: real fields of known types are zero, huge or not finite.
        """
        tree = ast.parse(module.read_bytes())
        text = module.read_text()
        self._chance, self._config = chance, config
        constants = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)]
        keys = set(re.findall(r"\[['\"](\w+)['\"]\]|get\(\s*['\"](\w+)['\"]", text))
        names = {a or b for a, b in keys} | {c for c in constants if isinstance(c, str) and c.isidentifier()}
        names |= set(re.findall(r"[{,]\s*(\w+)", " ".join(c for c in constants if isinstance(c, str) and "{" in c)))
        self._known, self._optional, self._real = fields, optional, "odd" if odd else "float"
        self._fields = sorted(names - {"time", "topic", "service", "request", "response", "t", "PROPERTY"})[:24]
        self._numbers = sorted(
            {c for c in constants if isinstance(c, int | float) and not isinstance(c, bool)} | {0, 1, 2, -1}
        )
        self._numbers += [float(n) for n in re.findall(r"[<>=]\s*(-?\d+(?:\.\d+)?)", " ".join(map(str, constants)))]
        self._texts = [*sorted({c for c in constants if isinstance(c, str) and 0 < len(c) < 30}), "", "other", "True"]

    def trace(self, length: int) -> list[Event]:
        """One trace; each field of each stream has one type in it, now and then another, and may be missing."""
        names = self._fields if self._known is None else list(self._known)
        kinds = {(i.name, f): self._kind(f) for i in self._config.interfaces for f in names}
        time, found = 1000.5, []
        for _ in range(length):
            time += self._chance.choice((0.25, 0.5, 1.0, 3.0))
            found.append(self._event(kinds, time))
        return found

    def _event(self, kinds: dict[tuple[str, str], str | list[str]], time: float) -> Event:
        interface = self._chance.choice(self._config.interfaces)
        name = interface.name.removeprefix("/") if interface.bare else interface.name
        stream = self._chance.choice(streams_of(interface, TYPES))
        if stream.message is not None:
            typed = self._of_shape(stream.message.shape)
            whole = typed if stream.kind == "topic" else {stream.kind: typed}
            return {stream.key: name, "time": time, **whole}
        own = {f: kind for (where, f), kind in kinds.items() if where == interface.name and kind != "none"}
        message = {f: self._value(kind) for f, kind in own.items() if not self._missing()}
        if interface.kind == "topic":
            return {"topic": name, "time": time, **message}
        return {"service": name, "time": time, self._chance.choice(("request", "response")): message}

    def _of_shape(self, shape: Shape) -> Any:
        match shape:
            case Record(fields=fields):
                return {name: self._of_shape(inner) for name, inner in fields.items()}
            case Many(of=of, length=length):
                count = self._chance.choice((0, 1, 2, 3, 5)) if length is None else length
                return [self._of_shape(of) for _ in range(count)]
            case Value(kind="whole", type=name):
                least = 0 if name.startswith("u") else -(2**7)
                return max(least, self._value("int"))
            case Value(kind="bytes"):
                return ""
            case Value(kind=kind):
                return self._value(self._real if kind == "real" else kind)

    def _missing(self) -> bool:
        return self._known is not None and self._optional and self._chance.random() < 0.1

    def _kind(self, name: str) -> str | list[str]:
        if self._known is not None:
            return "none" if self._optional and self._chance.random() < 0.2 else self._known[name]
        return self._chance.choice(
            ("bool", "bool", "int", "float", "float", "number", "text", "text", "list", "dict", "none", "any")
        )

    def _value(self, kind: str | list[str]) -> Any:
        chance = self._chance
        if isinstance(kind, list):
            return chance.choice(kind)
        if kind == "any":
            kind = chance.choice(("bool", "int", "float", "text"))
        if kind == "bool":
            return chance.random() < 0.5
        if kind in ("int", "float", "number"):
            near = chance.choice(self._numbers) + chance.choice((-1, -0.25, 0, 0, 0.25, 1))
            whole = kind == "int" or (kind == "number" and chance.random() < 0.5)
            return int(near) if whole else float(near)
        if kind == "odd":
            return chance.choice((0, 0.0, -0.0, 1, -2.5, 1e200, -1e200, math.inf, -math.inf, math.nan))
        if kind == "numeral":
            return chance.choice((0, 1, 2.5, 4, 5.0, "0", "2", "2.5", "NaN "))
        if kind == "text":
            text = chance.choice(self._texts)
            return chance.choice((text, text, text, text.upper(), text.title(), f" {text}\n", f"{text}!", f"an {text}"))
        if kind == "dict":
            inner = chance.choice(("float", "float", "bool"))
            inner = inner if self._known is None else "number"
            return {f: self._value(inner) for f in self._fields[:12]} | {k: self._value(inner) for k in "xyz"}
        return [self._value("float") for _ in range(chance.choice((3, 3, 400)))]


def configuration(module: Path, services: bool = False) -> Config:
    """A configuration with the topics that a module names, and another."""
    text = module.read_text()
    topics = re.findall(r"topic['\"]\]?\)?\s*(?:==|!=|in)\s*\[?\(?['\"]([\w/]+)['\"]", text)
    topics += re.findall(r"topic\s*==\s*['\"]([\w/]+)['\"]", text)
    called = re.findall(r"service['\"]?\]?\)?\s*==\s*['\"]([\w/]+)['\"]", text)
    names = list(dict.fromkeys(n.strip("/") for n in topics)) or ["chatter"]
    items = [{"name": f"{'/' if f'/{n}' in text else ''}{n}", "action": "log"} for n in (*names, "elsewhere")]
    monitor: dict[str, Any] = {"id": "monitor", "oracle": {"url": "127.0.0.1", "port": 8080}, "topics": items}
    wanted = dict.fromkeys(n.strip("/") for n in called) or (["called"] if services else [])
    monitor["services"] = [{"name": n, "action": "log"} for n in wanted]
    return read_config({"monitors": [{"monitor": monitor}]}, "made")


def random_traces(
    module: Path,
    config: Config,
    seed: int,
    count: int,
    length: int = 12,
    fields: Mapping[str, str | list[str]] | None = None,
    optional: bool = True,
    odd: bool = False,
) -> Iterator[list[Event]]:
    """Traces for a module and a configuration."""
    traffic = Traffic(module, config, random.Random(seed), fields, optional, odd)
    for _ in range(count):
        yield traffic.trace(length)


def _main() -> None:
    options = argparse.ArgumentParser()
    options.add_argument("modules", nargs="+", type=Path)
    options.add_argument("--config", type=Path)
    options.add_argument("--traces", type=int, default=200)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--show", action="store_true")
    asked = options.parse_args()
    for module in asked.modules:
        try:
            config = configuration(module)
            if asked.config:
                config = read_config(yaml.safe_load(asked.config.read_bytes()), str(asked.config))
            found = compare(config, module, list(random_traces(module, config, asked.seed, asked.traces)))
        except OracleError as error:
            print(f"{module.name}: refused: {error}")
            continue
        word = "DIFFERENT" if found.different else "external" if found.external else "todo" if found.todos else "same"
        print(f"{module.name}: {word}: {found.same} the same, {found.unknown} unknown, values {sorted(found.values)}")
        if found.different or asked.show:
            print(found.text, *(json.dumps(e) for e in found.different or ()), sep="\n")


if __name__ == "__main__":
    _main()
