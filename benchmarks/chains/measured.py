"""Latencies, and what they are compared with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

GOAL_P50, GOAL_P99 = 1.3, 1.5
ACCEPTED, BESIDE = 0.5, 0.2
"""Milliseconds that the acceptance of a goal, and a call of one of several services, may take more than a call."""


@dataclass
class Measured:
    """Latencies in ms of one path."""

    sent: int = 0
    latencies: list[float] = field(default_factory=list)

    def quantile(self, share: float) -> float:
        ordered = sorted(self.latencies)
        return ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)] if ordered else math.nan

    @property
    def lost(self) -> int:
        return self.sent - len(self.latencies)


def rows(found_of: Mapping[tuple[str, str], Measured]) -> list[dict[str, Any]]:
    found = []
    for (case, path), measured in sorted(found_of.items(), key=lambda item: item[0][0]):
        bare_chain = found_of[case, "bare"]
        found.append(
            {
                "case": case,
                "path": path,
                "sent": measured.sent,
                "lost": measured.lost,
                "p50_ms": round(measured.quantile(0.5), 3),
                "p99_ms": round(measured.quantile(0.99), 3),
                "p50_ratio": round(measured.quantile(0.5) / bare_chain.quantile(0.5), 2),
                "p99_ratio": round(measured.quantile(0.99) / bare_chain.quantile(0.99), 2),
            }
        )
    return found


def verdict(row: dict[str, Any]) -> str:
    if row["path"] != "oracle":
        return ""
    good = row["p50_ratio"] <= GOAL_P50 and row["p99_ratio"] <= GOAL_P99 and row["lost"] == 0
    return "met" if good else "missed"


def print_table(found: list[dict[str, Any]]) -> None:
    print(
        f"{'':29}{'path':8}{'sent':>6}{'lost':>6}{'p50 ms':>9}{'p99 ms':>9}{'p50 x bare':>12}{'p99 x bare':>12}  goal"
    )
    for row in found:
        print(
            f"{row['case']:29}{row['path']:8}{row['sent']:6}{row['lost']:6}{row['p50_ms']:9.3f}{row['p99_ms']:9.3f}"
            f"{row['p50_ratio']:12.2f}{row['p99_ratio']:12.2f}  {verdict(row)}"
        )
    print(f"goal: p50 <= {GOAL_P50} x and p99 <= {GOAL_P99} x the bare chain, and none lost")


def print_goals(found_of: Mapping[tuple[str, str], Measured], kept: Sequence[int]) -> None:
    """What is compared with something else than its own bare chain, at 50 %."""
    call = found_of["service", "oracle"].quantile(0.5)

    def more(what: str, case: str, most: float) -> None:
        found = found_of[case, "oracle"].quantile(0.5) - call
        print(f"{what}: {found:+.3f} ms; goal: {most} ms at most: {'met' if found <= most else 'missed'}")

    def times(what: str, case: str) -> None:
        found = found_of[case, "oracle"].quantile(0.5) / found_of[case, "bare"].quantile(0.5)
        print(f"{what}: {found:.2f} x; goal: {GOAL_P50} x at most: {'met' if found <= GOAL_P50 else 'missed'}")

    more("one of 4 proxied services beside one alone", "one of 4 services", BESIDE)
    for count in kept:
        more(f"acceptance of a goal beside a proxied service, {count} kept", f"goal to reply, {count} kept", ACCEPTED)
        times(f"feedback that is logged beside the bare chain, {count} kept", f"feedback at 100 Hz, {count} kept")
        times(f"from goal to result beside the bare chain, {count} kept", f"goal to result, {count} kept")
