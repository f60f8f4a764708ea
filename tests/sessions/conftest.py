"""Histories of every backend."""

from __future__ import annotations

from tests.history.backends import make, postgres
from tests.history.conftest import reader

__all__ = ["make", "postgres", "reader"]
