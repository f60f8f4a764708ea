"""The reports of `replay`, by their format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import IO, Literal, Protocol

from oracle_server.core.verdicts import Judged
from oracle_server.replay.report.github import GithubReport, Marked
from oracle_server.replay.report.junit import JunitReport
from oracle_server.replay.report.lines import JsonReport
from oracle_server.replay.report.table import CsvReport
from oracle_server.replay.report.text import TextReport
from oracle_server.replay.run import Replay

Format = Literal["text", "jsonl", "csv", "junit", "github"]


class Report(Protocol):
    """Writes a report of replays, one after the other."""

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Add a judged step."""
        ...

    def ended(self, replay: Replay) -> None:
        """Add the summary of a replay that has ended."""
        ...

    def finish(self, why: str = "") -> None:
        """End the report; `why`: an input can't be used, so that not all was judged, which standard error says, too."""
        ...


def make_report(
    form: Format,
    out: IO[str],
    *,
    several: bool,
    signals: bool = False,
    specs: Sequence[Marked] = (),
) -> Report:
    """A report that is written to `out`; with `several` specs, each record names its spec.

    With `signals` a report as text counts the signals of every stream; one of annotations marks places in the `specs`,
    which are those of the replays, in their order, and may be added later.
    """
    if form == "github":
        return GithubReport(out, specs)
    if form == "text":
        return TextReport(out, several, signals=signals)
    kinds: dict[Format, Callable[[IO[str], bool], Report]] = {
        "jsonl": JsonReport,
        "csv": CsvReport,
        "junit": JunitReport,
    }
    return kinds[form](out, several)
