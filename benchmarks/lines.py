"""What a benchmark prints: each figure beside its baseline, and whether it meets its goal."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Line:
    """A line of the table: `ratio` is `value` by `baseline`; `goal` bounds it, from above where it is a time."""

    what: str
    unit: str
    value: float
    baseline: float
    goal: float | None = None

    @property
    def ratio(self) -> float:
        return self.value / self.baseline

    @property
    def rises(self) -> bool:
        """Whether more is better."""
        return self.unit == "events/s"

    @property
    def met(self) -> bool | None:
        if self.goal is None:
            return None
        return self.ratio >= self.goal if self.rises else self.ratio <= self.goal


def table(lines: list[Line], heads: tuple[str, str] = ("oracle", "bare")) -> str:
    rows = [("", *heads, "", "ratio", "goal", "")]
    for line in lines:
        goal = "" if line.goal is None else f"{'≥' if line.rises else '≤'} {line.goal}"
        verdict = {None: "", True: "met", False: "MISSED"}[line.met]
        rows.append(
            (line.what, f"{line.value:,.0f}", f"{line.baseline:,.0f}", line.unit, f"{line.ratio:.2f}", goal, verdict)
        )
    widths = [max(len(row[i]) for row in rows) for i in range(7)]
    left = frozenset({0, 3, 5, 6})
    return "\n".join(
        "  ".join(
            cell.ljust(w) if i in left else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )
