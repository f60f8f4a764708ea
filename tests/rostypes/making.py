"""Packages of definitions, made for tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def package(folder: Path, files: Mapping[str, str]) -> Path:
    """A package with these files, by their paths in it."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode(errors="surrogateescape"))
    return folder
