"""What is to be said of a verdict record in a few words."""

from __future__ import annotations

from typing import Any

from oracle_server.core.errors import one_line
from oracle_server.core.naming import retraction_text


def record_marks(record: dict[str, Any]) -> str:
    """How a record's event came, which revision the record is by, and which verdicts it revises."""
    marks = [mark for mark in ("late", "skewed", "degraded") if record[mark]]
    if record.get("unheard"):
        marks.append(f"unheard: {', '.join(record['unheard'])}")
    if record.get("revised"):
        marks.append(f"by #{record['revised']}")
    if record.get("revises"):
        first, last = record["revises"]["from"], record["revises"]["to"]
        marks.append(f"of #{first}" if first == last else f"of #{first} to #{last}")
    return " ".join(marks)


def violation_text(record: dict[str, Any]) -> str:
    """Why a record is a violation, or why one is retracted by it."""
    retracted = record.get("retracted")
    return one_line(f"retracted: {retraction_text(record)}" if retracted else record["explanation"]["text"])
