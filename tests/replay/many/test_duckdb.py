"""The question in docs/recordings.md, asked by DuckDB of 10,000 rows."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import duckdb
import msgspec

from oracle_server.replay.many.row import COLUMNS, Row
from oracle_server.replay.many.tablefile import format_of
from tests.processes import ROOT
from tests.replay.many.recordings import judged, question, write_recordings, write_specs

DOCUMENT = (ROOT / "docs" / "recordings.md").read_text()
HOUR = 3600 * 10**9


def rows(folder: Path) -> list[Row]:
    """5,000 recordings of an hour, with two properties; every hundredth one is broken."""
    (spec, _), (recording,) = write_specs(folder), write_recordings(folder / "recordings", 1)
    below, slows = judged(question([spec]), recording)
    found = []
    for i in range(5_000):
        if i % 100 == 99:
            changes: dict[str, Any] = {
                "outcome": None,
                "violations": None,
                "episodes": None,
                "error": "broken",
                "last_at": None,
            }
        else:
            changes = {"first_at": 0, "last_at": HOUR, "episodes": 0, "violations": 0}
        changes["recording"] = f"r{i}.mcap"
        often = {"episodes": i % 3, "violations": i % 3} if changes.get("violations") is not None else {}
        found.append(msgspec.structs.replace(below, **changes | often))
        found.append(msgspec.structs.replace(slows, **changes | ({"episodes": 9, "violations": 20} if i == 7 else {})))
    return found


def test_it_is_answered(tmp_path: Path) -> None:
    (query,) = re.findall(r"```sql\n(.*?)```", DOCUMENT, re.DOTALL)
    table = tmp_path / "results.parquet"
    with table.open("wb") as out:
        format_of(table).write(rows(tmp_path), out)
    asked = duckdb.connect(config={"threads": 1})
    assert asked.execute(f"SELECT count(*) FROM '{table}'").fetchone() == (10_000,)
    found = asked.execute(query.replace("'results.parquet'", f"'{table}'")).fetchall()
    per_hour = sum(i % 3 for i in range(5_000) if i % 100 != 99) / 4_950
    assert [row[:4] for row in found] == [
        ("below_three", sum(i % 3 > 0 for i in range(5_000) if i % 100 != 99), 50, round(per_hour, 2)),
        ("slows", 1, 50, 0.0),
    ]
    assert found[1][4] == "r7.mcap"


def test_columns_are_told_and_hold_what_they_say(tmp_path: Path) -> None:
    told = re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`\w+`(?:, `\w+`)*) \|", DOCUMENT, re.MULTILINE)))
    assert set(COLUMNS) <= set(told)
    written = rows(tmp_path)[:300]
    for table in (tmp_path / "a.parquet", tmp_path / "a.jsonl", tmp_path / "a.csv"):
        form = format_of(table)
        with table.open("wb") as out:
            form.write(written, out)
        assert list(form.read(table)) == written
