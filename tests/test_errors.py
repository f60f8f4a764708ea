"""Errors are one tree: what catches its root catches all that is fit to be shown to a person."""

import importlib
import pkgutil
import re

import oracle_server
from oracle_server.core import errors
from oracle_server.core.errors import OracleError

CONTROL_FLOW = {"Absent", "Exhausted", "Failed", "Stopped"}
"""Never raised to a caller outside the module: no errors."""


def _raised() -> dict[str, type[BaseException]]:
    modules = pkgutil.walk_packages(oracle_server.__path__, "oracle_server.")
    found = {}
    for name in (m.name for m in modules if m.name != "oracle_server.__main__"):
        for value in vars(importlib.import_module(name)).values():
            if isinstance(value, type) and issubclass(value, BaseException) and value.__module__ == name:
                found[value.__name__] = value
    return found


def test_every_error_is_of_the_one_tree() -> None:
    strays = {name for name, error in _raised().items() if not issubclass(error, OracleError)}
    assert strays == CONTROL_FLOW


def test_every_error_is_listed_with_the_root() -> None:
    listed = set(re.findall(r"`(\w+Error)`", errors.__doc__ or ""))
    assert listed == {name for name in _raised() if name not in CONTROL_FLOW}
