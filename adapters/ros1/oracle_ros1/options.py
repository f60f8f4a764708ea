"""The adapter's options: on its command line, in the words of either kind, and as private parameters of the node."""

from __future__ import annotations

import argparse
import re
from typing import Any, Callable, Dict, FrozenSet, List, Optional, Sequence, Tuple

import rospy
import yaml
from oracle_adapter.command import default, demand_one_oracle, parser

LONGEST = 200
"""The most characters of a monitor's name."""
_PRIVATE = re.compile(r"_(?P<name>[a-z]+):=(?P<value>.*)", re.DOTALL)
_NOT_PRIVATE = frozenset({"remap", "dump_graph"})
_OTHERS: Sequence[Tuple[FrozenSet[str], FrozenSet[str]]] = (
    (frozenset({"log", "streams"}), frozenset({"oracle", "spec", "session", "embedded", "data"})),
    (frozenset({"embedded", "data"}), frozenset({"spec", "log", "streams"})),
    (frozenset({"oracle", "spec"}), frozenset({"log", "streams", "embedded", "data"})),
    (frozenset({"session"}), frozenset({"log", "streams"})),
)
"""Options that say where events go, and those that would say otherwise."""


def read_options(arguments: Sequence[str], description: Optional[str]) -> Tuple[argparse.Namespace, List[str]]:
    """The options that the command line gives, None where it gives none, and the arguments that are for ROS.

    `_name:=value` is an option too, and is kept from rospy: it would stay on the master for the next adapter. Ends the
    program where two of them contradict each other.
    """
    own, for_ros = _split(arguments)
    options = parser("oracle_ros1", description)
    options.add_argument("--dump-graph", action="store_true", help="print the live graph as JSON, and end")
    found = options.parse_args(own[1:])
    private = _private(for_ros, frozenset(vars(found)) - _NOT_PRIVATE)
    for name, value in private.items():
        if getattr(found, name) not in (None, value):
            options.error(f"--{name} and _{name}:= contradict each other: leave one of them out")
        setattr(found, name, value)
    for name, value in vars(found).items():
        setattr(found, name, None if value == "" else value)
    if len(found.monitor or "") > LONGEST:
        options.error(f"--monitor: a name has at most {LONGEST} characters, as ROS names a file by it")
    try:
        demand_one_oracle(found)
    except ValueError as error:
        options.error(str(error))
    known = frozenset(f"_{name}" for name in private)
    return found, [word for word in for_ros if word.partition(":=")[0] not in known]


def complete(options: argparse.Namespace, warn: Callable[[str], None], tell: Callable[[str], None]) -> None:
    """Take what the command line does not give from a private parameter, or by default.

    A parameter may be left from an earlier run: one that would send events elsewhere than the command line says is
    not taken, which `warn` is told. Or it may be the robot's own: `tell` gets which are taken. Raises
    ValueError where parameters contradict each other.
    """
    given = frozenset(name for name, value in vars(options).items() if value is not None)
    taken: List[str] = []
    others: FrozenSet[str] = next((others for names, others in _OTHERS if names & given), frozenset())
    for name in vars(options).keys() - given:
        found = _as_text(rospy.get_param(f"~{name}", ""))
        if found and name in others:
            warn(f"the parameter {rospy.resolve_name(f'~{name}')} is not taken: the command line says otherwise")
        elif found:
            setattr(options, name, found)
            taken.append(rospy.resolve_name(f"~{name}") + ("" if name == "token" else f" = {found}"))
    if taken:
        tell(f"options by parameters: {', '.join(sorted(taken))}")
    demand_one_oracle(options)
    for name, value in vars(options).items():
        if value is None:
            setattr(options, name, default(name))


def _as_text(value: Any) -> str:
    """A parameter as an option; none where it is a namespace, as the robot has under the name of its monitor."""
    return "" if isinstance(value, dict) else str(value)


def _split(arguments: Sequence[str]) -> Tuple[List[str], List[str]]:
    """The adapter's own arguments, and ROS's: its remaps are `a:=b` too, but none follows `--remap`."""
    own: List[str] = []
    for_ros: List[str] = []
    for before, word in zip(["", *arguments], arguments):
        is_ros = ":=" in word and before != "--remap" and not word.startswith("--remap=")
        (for_ros if is_ros else own).append(word)
    return own, for_ros


def _private(words: Sequence[str], names: FrozenSet[str]) -> Dict[str, str]:
    """The private parameters among ROS's arguments that are options; an empty one is as none."""
    found = [_PRIVATE.fullmatch(word.strip()) for word in words]
    values = {f["name"]: _text(f["value"].strip()) for f in found if f and f["name"] in names}
    return {name: value for name, value in values.items() if value}


def _text(value: str) -> str:
    """A value as ROS reads it, who takes it for YAML: a text may be in quotes."""
    try:
        read = yaml.safe_load(value)
    except yaml.YAMLError:
        return value
    return read if isinstance(read, str) else value
