"""Violations by property: counted for so many, and together beyond."""

from __future__ import annotations

from typing import Any

import structlog

from oracle_server.sessions.violated import MOST, OTHER, Violated


def violation(prop: str, order: str = "publication", kind: str = "violation") -> Any:
    return {"type": kind, "property": prop, "order": order}


def test_what_is_beyond_the_bound_is_counted_as_other_and_said_once() -> None:
    counted = Violated()
    counted.expect("big", (f"p{i}" for i in range(MOST)))
    with structlog.testing.capture_logs() as logs:
        counted.add("later", [violation("p"), violation("q")], "publication")
        counted.add("big", [violation("p7")], "publication")
        counted.expect("later", ["r"])
    assert len(counted.counts) == MOST + 1
    assert (counted.counts[OTHER], counted.counts["big", "p7"]) == (2, 1)
    assert [line["most"] for line in logs] == [MOST]


def test_violations_of_one_order_are_counted_and_nothing_else() -> None:
    counted = Violated()
    told = [violation("p"), violation("p", order="arrival"), violation("p", kind="revision"), violation("q")]
    counted.add("s", told, "publication")
    assert counted.counts == {("s", "p"): 1, ("s", "q"): 1}
