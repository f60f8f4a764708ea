"""Latencies, and what they are compared with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

GOAL_P50, GOAL_P99 = 1.3, 1.5
ACCEPTED, BESIDE = 0.5, 0.2
"""Milliseconds that the acceptance of a goal may take more than a call, beyond what it does without a proxy; and a call
of one of several services."""
RESTED = "service, 0.1 s apart"
"""The service as a goal is sent where few are kept: all processes have slept before."""


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
        f"{'':36}{'path':8}{'sent':>6}{'lost':>6}{'p50 ms':>9}{'p99 ms':>9}{'p50 x bare':>12}{'p99 x bare':>12}  goal"
    )
    for row in found:
        print(
            f"{row['case']:36}{row['path']:8}{row['sent']:6}{row['lost']:6}{row['p50_ms']:9.3f}{row['p99_ms']:9.3f}"
            f"{row['p50_ratio']:12.2f}{row['p99_ratio']:12.2f}  {verdict(row)}"
        )
    print(f"goal: p50 <= {GOAL_P50} x and p99 <= {GOAL_P99} x the bare chain, and none lost")


def print_goals(found_of: Mapping[tuple[str, str], Measured], kept: Sequence[int], few: int) -> None:
    """What is compared with something else than its own bare chain, at 50 %; `few` goals are sent with pauses."""

    def more(case: str, call: str, path: str) -> float:
        return found_of[case, path].quantile(0.5) - found_of[call, path].quantile(0.5)

    def tell(what: str, found: float, text: str, most: float, unit: str) -> None:
        print(f"{what}: {text}; goal: {most} {unit} at most: {'met' if found <= most else 'missed'}")

    def times(what: str, case: str) -> None:
        found = found_of[case, "oracle"].quantile(0.5) / found_of[case, "bare"].quantile(0.5)
        tell(what, found, f"{found:.2f} x", GOAL_P50, "x")

    beside = more("one of 4 services", "service", "oracle")
    tell("one of 4 proxied services beside one alone", beside, f"{beside:+.3f} ms", BESIDE, "ms")
    for count in kept:
        call = RESTED if count == few else "service"
        for case in (f"goal to reply, {count} kept", f"reply to a goal begun later, {count} kept"):
            if (case, "oracle") in found_of:
                direct, bare, oracle = (more(case, call, path) for path in ("direct", "bare", "oracle"))
                text = f"{oracle:+.3f} ms, direct {direct:+.3f}, by the bare chain {bare:+.3f}"
                tell(
                    f"{case}, beside a {call}", oracle - direct, f"{text}: {oracle - direct:+.3f} ours", ACCEPTED, "ms"
                )
        times(f"feedback that is logged beside the bare chain, {count} kept", f"feedback at 100 Hz, {count} kept")
        times(f"from goal to result beside the bare chain, {count} kept", f"goal to result, {count} kept")
