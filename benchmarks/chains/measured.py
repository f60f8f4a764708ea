"""Latencies, and what they are compared with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

GOAL_P50, GOAL_P99 = 1.3, 1.5
EMBEDDED_P50, EMBEDDED_P99 = {"topic at 100 Hz": 2.2, "topic at 1000 Hz": 2.5}, 3.0
"""By the direct path."""
ACCEPTED, BESIDE = 0.5, 0.2
"""Milliseconds that the acceptance of a goal may take more than a call, beyond what it does without a proxy; and a call
of one of several services."""
RESTED = "service, 0.1 s apart"
"""The service as goals are sent: all processes have slept before."""


@dataclass
class Measured:
    """Latencies in ms of one path."""

    sent: int = 0
    latencies: list[float] = field(default_factory=list)
    cpu: float = 0.0
    """CPU seconds of the processes between the nodes; `nan` where they can't be told from those of other cases."""

    def quantile(self, share: float) -> float:
        ordered = sorted(self.latencies)
        return ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)] if ordered else math.nan

    @property
    def lost(self) -> int:
        return self.sent - len(self.latencies)


def rows(found_of: Mapping[tuple[str, str], Measured]) -> list[dict[str, Any]]:
    found = []
    for (case, path), measured in sorted(found_of.items(), key=lambda item: item[0][0]):
        bare_chain, direct = found_of[case, "bare"], found_of[case, "direct"]
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
                "p50_by_direct": round(measured.quantile(0.5) / direct.quantile(0.5), 2),
                "p99_by_direct": round(measured.quantile(0.99) / direct.quantile(0.99), 2),
                "cpu_us": None if math.isnan(measured.cpu) else round(1e6 * measured.cpu / measured.sent),
            }
        )
    return found


def verdict(row: dict[str, Any]) -> str:
    if row["path"] == "oracle":
        good = row["p50_ratio"] <= GOAL_P50 and row["p99_ratio"] <= GOAL_P99
    elif row["path"] == "embedded" and row["case"] in EMBEDDED_P50:
        good = row["p50_by_direct"] <= EMBEDDED_P50[row["case"]] and row["p99_by_direct"] <= EMBEDDED_P99
    else:
        return ""
    good = good and row["lost"] == 0
    return "met" if good else "missed"


def print_table(found: list[dict[str, Any]]) -> None:
    print(
        f"{'':36}{'path':10}{'sent':>6}{'lost':>5}{'p50 ms':>9}{'p99 ms':>9}{'x bare':>13}{'x direct':>14}"
        f"{'CPU us':>8}  goal"
    )
    for row in found:
        by_bare = f"{row['p50_ratio']:.2f}, {row['p99_ratio']:.2f}"
        by_direct = f"{row['p50_by_direct']:.2f}, {row['p99_by_direct']:.2f}"
        cpu = "" if row["cpu_us"] is None else row["cpu_us"]
        print(
            f"{row['case']:36}{row['path']:10}{row['sent']:6}{row['lost']:5}{row['p50_ms']:9.3f}{row['p99_ms']:9.3f}"
            f"{by_bare:>13}{by_direct:>14}{cpu:>8}  {verdict(row)}"
        )
    print(
        f"CPU us: microseconds of the processor a message, of all that stands between the nodes\n"
        f"goal: with the oracle p50 <= {GOAL_P50} x and p99 <= {GOAL_P99} x the bare chain; embedded, topics: p50 <= "
        f"{' and '.join(f'{most} x at {case[9:]}' for case, most in EMBEDDED_P50.items())}, p99 <= {EMBEDDED_P99} x "
        "the direct one; none lost"
    )


def print_goals(found_of: Mapping[tuple[str, str], Measured], kept: Sequence[int]) -> None:
    """What is compared with something else than its own bare chain, at 50 %."""

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
        for case in (f"goal to reply, {count} kept", f"reply to a goal begun later, {count} kept"):
            if (case, "oracle") in found_of:
                direct, bare, oracle = (more(case, RESTED, path) for path in ("direct", "bare", "oracle"))
                text = f"{oracle:+.3f} ms, direct {direct:+.3f}, by the bare chain {bare:+.3f}"
                tell(
                    f"{case}, beside a {RESTED}",
                    oracle - direct,
                    f"{text}: {oracle - direct:+.3f} ours",
                    ACCEPTED,
                    "ms",
                )
        times(f"feedback that is logged beside the bare chain, {count} kept", f"feedback at 100 Hz, {count} kept")
        times(f"from goal to result beside the bare chain, {count} kept", f"goal to result, {count} kept")
