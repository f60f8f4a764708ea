"""Reads a property module of ROSMonitoring's oracle from its syntax tree; it is never imported."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from pathlib import Path

from oracle_server.specfiles.rosmonitoring.config import ConfigError


@dataclass(frozen=True, slots=True)
class PropertyModule:
    """A module's formula, its predicates' initial values, and its function `abstract_message`."""

    name: str
    formula: str
    initial: dict[str, object]
    function: ast.FunctionDef | None

    @property
    def truths(self) -> frozenset[str]:
        """The Boolean predicates: with them, `True` in Rye is the Boolean value; with all others, the text."""
        body = self.function.body if self.function else []
        texts = {
            _target(node)
            for statement in body
            for node in ast.walk(statement)
            if isinstance(node, ast.Assign)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        }
        return frozenset(name for name in self.initial if name not in texts)


def read_module(path: Path) -> PropertyModule:
    """Read a property module. Raises `ConfigError` with file and line."""
    try:
        tree = ast.parse(path.read_bytes(), str(path))
    except OSError as error:
        raise ConfigError(f"{path}: can't be read: {error.strerror}") from None
    except (SyntaxError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}:{getattr(error, 'lineno', 1)}: not Python: {getattr(error, 'msg', error)}") from None
    formula: str | None = None
    initial: dict[str, object] = {}
    function = None
    for statement in tree.body:
        match statement:
            case ast.Assign([ast.Name("PROPERTY")], ast.Constant(str() as text)):
                formula = text
            case ast.Assign([ast.Name("predicates")], value):
                initial = _initial(value)
            case ast.FunctionDef(name="abstract_message"):
                function = statement
    if formula is None:
        raise ConfigError(f"{path}: not a property module: it has no `PROPERTY = '…'`")
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", path.stem)[:64]
    return PropertyModule(name, " ".join(formula.split()), initial, function)


def _initial(value: ast.expr) -> dict[str, object]:
    pairs: list[tuple[object, ast.expr]] = []
    if isinstance(value, ast.Call):
        pairs = [(k.arg, k.value) for k in value.keywords if k.arg]
    elif isinstance(value, ast.Dict):
        pairs = [(k.value, v) for k, v in zip(value.keys, value.values, strict=True) if isinstance(k, ast.Constant)]
    return {str(name): v.value if isinstance(v, ast.Constant) else None for name, v in pairs}


def _target(node: ast.Assign) -> object:
    target = node.targets[0]
    inside = isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Constant)
    return target.slice.value if inside else None  # type: ignore[attr-defined]
