"""A property module judged in the original way: really run, with reelay, as ROSMonitoring's temporal-logic oracle does.

Run as a program it reads one request from standard input, so that a module or a formula that ends the process ends no
test: `{"module": path, "formula": text or null, "traces": [[event, …], …]}`. For each event of each trace it prints a
line, `true` or `false`; a trace ends early at an event at which the module or reelay fails, by `null` unless a field is
missing.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import os
import subprocess
import sys
import types
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

Event = dict[str, Any]


def judged(module: Path, traces: Sequence[Sequence[Event]], formula: str | None = None) -> list[list[bool | None]]:
    """What the original says of each event, for each trace up to the first event at which it fails, which is None.

    A trace ends without that at a message that lacks a field.

    `formula` is put in the place of the module's, where that is of a dialect that reelay does not read.
    """
    request = {"module": str(module), "formula": formula, "traces": traces}
    ended = subprocess.run(
        [sys.executable, __file__], input=json.dumps(request), capture_output=True, encoding="utf-8", check=False
    )
    found: list[list[bool | None]] = []
    for line in ended.stdout.splitlines():
        value = json.loads(line)
        if value == "trace":
            found.append([])
        else:
            found[-1].append(value)
    return found


class _Name(str):
    """A topic's name: the same with and without its leading slash, as everywhere in this project."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, str) and self.strip("/") == other.strip("/")

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash(self.strip("/"))


def _main() -> None:
    """Judge each trace in a child: reelay takes 25 ms for a monitor, which has no way back to its beginning."""
    request = json.load(sys.stdin)
    with contextlib.redirect_stdout(io.StringIO()):
        module, monitor = _prepared(Path(request["module"]), request["formula"])
    for trace in request["traces"]:
        print(json.dumps("trace"), flush=True)
        child = os.fork()
        if not child:
            out = sys.stdout
            with contextlib.redirect_stdout(io.StringIO()):
                verdicts = _judge(module, monitor, trace)
            for verdict in verdicts:
                print(json.dumps(verdict), file=out, flush=True)
            os._exit(0)
        os.waitpid(child, 0)


def _prepared(path: Path, formula: str | None) -> tuple[types.ModuleType, Any]:
    import reelay

    sys.modules["oracle"] = types.SimpleNamespace(  # type: ignore[assignment]
        TypeOfProperty=types.SimpleNamespace(PTL=0, PLTL=0, MTL=1, PMTL=1, STL=2, PSTL=2)
    )
    found = importlib.util.spec_from_file_location("the_property", path)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module, reelay.discrete_timed_monitor(pattern=formula or module.PROPERTY)


def _judge(module: types.ModuleType, monitor: Any, trace: Sequence[Event]) -> Iterable[bool | None]:
    verdicts: list[bool | None] = []
    first, last = None, True
    for sent in trace:
        event = json.loads(json.dumps(sent))
        if "topic" in event:
            event["topic"] = _Name(event["topic"])
        if "service" in event:
            event["service"] = _Name(event["service"])
        if "time" in event:
            first = event["time"] if first is None else first
            event["time"] = event["time"] - first
        try:
            said = monitor.update(module.abstract_message(event))
        except KeyError:  # a field that is missing, which ROS's messages never lack
            break
        except Exception:  # noqa: BLE001 -- its connection is lost, whatever it was
            verdicts.append(None)
            break
        last = said["value"] if said else last
        verdicts.append(bool(last))
    return verdicts


if __name__ == "__main__":
    _main()
