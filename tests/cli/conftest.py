"""A running server for the commands that read one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.whole.conftest import copy_specs
from tests.whole.harness import Server


@pytest.fixture(scope="package")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Tests share it, and take session names of their own."""
    folder = tmp_path_factory.mktemp("cli")
    with Server(copy_specs(folder / "specs"), folder / "data") as running:
        yield running
