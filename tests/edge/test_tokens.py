"""The file of tokens: changed by many at once, lost, or spoilt."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from oracle_server.edge.tokens import Tokens, add, listed, remove


def test_tokens_that_come_and_go_at_once_undo_each_other_nowhere(tmp_path: Path) -> None:
    file, names = tmp_path / "tokens.json", [f"t{i}" for i in range(30)]
    add(file, "gone", ["read"])
    with ThreadPoolExecutor(8) as threads:
        making = [threads.submit(add, file, name, ["read"]) for name in names]
        removing = threads.submit(remove, file, "gone")
        assert len({made.result() for made in making}) == len(names)
        removing.result()
    assert sorted(token.name for token in listed(file)) == sorted(names)


SPOILING: list[Callable[[Path], object]] = [
    lambda file: file.unlink(),
    lambda file: file.write_text("{"),
    lambda file: file.write_text('{"tokens": []}'),
    lambda file: file.chmod(0o644),
]


@pytest.mark.parametrize("spoil", SPOILING, ids=["lost", "broken", "empty", "readable"])
def test_a_file_that_is_spoilt_lets_nobody_in(tmp_path: Path, spoil: Callable[[Path], object]) -> None:
    file = tmp_path / "tokens.json"
    secret = add(file, "a", ["admin"])
    tokens = Tokens(file)
    assert tokens.grant(secret)
    spoil(file)
    assert tokens.grant(secret) is None
    assert tokens.grant(None) is None
