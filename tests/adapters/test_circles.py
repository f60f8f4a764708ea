"""No module imports itself through others; imports for type checking count, as they tie modules just the same."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = [
    "oracle_server",
    "adapters/common/oracle_adapter",
    "adapters/ros1/oracle_ros1",
    "adapters/ros2/oracle_ros2",
]
Imports = Mapping[str, set[str]]


def modules(package: Path) -> dict[str, Path]:
    """The files of a package by their modules' dotted names; a package stands for its `__init__.py`."""
    found = {}
    for path in package.rglob("*.py"):
        parts = path.relative_to(package.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(tree: ast.Module, module: str, *, is_package: bool) -> Iterator[str]:
    """Every name that is imported, wherever it stands, and what it is imported from."""
    parts = module.split(".") if is_package else module.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = parts[: len(parts) - node.level + 1] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{origin}.{alias.name}" for alias in node.names)


def imports(package: Path) -> Imports:
    """What each module of a package imports of it: the module of a name where the name is none itself."""
    files = modules(package)
    found: dict[str, set[str]] = {}
    for module, path in files.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = list(imported(tree, module, is_package=path.name == "__init__.py"))
        found[module] = {n if n in files else n.rpartition(".")[0] for n in names} & files.keys()
    return found


def reachable(start: str, edges: Imports) -> set[str]:
    """The modules that are imported by `start`, or by one that is."""
    found: set[str] = set()
    left = [start]
    while left:
        fresh = edges[left.pop()] - found
        found |= fresh
        left += fresh
    return found


def circle(start: str, edges: Imports) -> str:
    """The shortest way of imports from a module back to it."""
    ways = [[start]]
    for way in ways:  # grows meanwhile: the shorter ways come first
        for target in sorted(edges[way[-1]]):
            if target == start:
                return " -> ".join([*way, start])
            if target not in way:
                ways.append([*way, target])
    raise AssertionError(f"there is no way back to {start}")


def circles(edges: Imports) -> list[str]:
    """One circle of each strongly connected component: modules of which each reaches the others."""
    reach = {module: reachable(module, edges) for module in edges}
    components = {frozenset(m for m in reach[one] if one in reach[m]) for one in reach if one in reach[one]}
    return sorted(circle(min(members), {m: edges[m] & members for m in members}) for members in components)


@pytest.mark.parametrize("package", PACKAGES)
def test_modules_import_each_other_in_no_circle(package: str) -> None:
    edges = imports(ROOT / package)
    assert any(edges.values())
    assert circles(edges) == []


def test_a_circle_is_found_through_relative_imports_and_those_for_types(tmp_path: Path) -> None:
    package = tmp_path / "shop"
    (package / "sub").mkdir(parents=True)
    sources = {
        "__init__.py": "from shop.a import Thing",
        "a.py": "import shop.b",
        "b.py": "def late():\n    from .sub import c",
        "sub/__init__.py": "",
        "sub/c.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ..a import Thing",
        "alone.py": "from . import a",
    }
    for name, source in sources.items():
        (package / name).write_text(source, encoding="utf-8")
    assert circles(imports(package)) == ["shop.a -> shop.b -> shop.sub.c -> shop.a"]
