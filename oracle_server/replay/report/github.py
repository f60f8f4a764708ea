"""The report of `replay` as annotations of GitHub: what was violated is marked at the property's line of the spec."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import IO, Any, Literal, NamedTuple

from oracle_server.core.verdicts import Judged
from oracle_server.replay.conclusion import UNJUDGED, Conclusion, conclude
from oracle_server.replay.report.violated import episode_lines, violated_text
from oracle_server.replay.run import Replay
from oracle_server.specfiles.annotations import annotation, remark
from oracle_server.specfiles.document import Position


class Marked(NamedTuple):
    """The file of a spec as it was named, and where the id of each property stands in it."""

    file: str
    places: Mapping[str, Position]


class GithubReport:
    """A line for each property that was violated or not judged, and for whatever else keeps a replay from success."""

    def __init__(self, out: IO[str], specs: Sequence[Marked]) -> None:
        """`specs` are those of the replays, in their order: several files may have one id."""
        self._out, self._specs = out, iter(specs)

    def judged(self, replay: Replay, judged: Judged) -> None:  # noqa: ARG002 -- as all of them
        """Keep nothing: episodes are known at the end."""
        replay.comparison.take()

    def ended(self, replay: Replay) -> None:
        """Write the lines of one replay."""
        marked = next(self._specs)
        path = f"{replay.recording.path}: "
        for severity, name, text in _told(replay, conclude(replay)):
            place = marked.places.get(name.removesuffix(" (arrival)"), (1, 1))
            said = f"{name}: {text}" if name else text.removeprefix(path)
            self._out.write(annotation(severity, marked.file, place, path + said) + "\n")

    def finish(self, why: str = "") -> None:
        """Write why an input can't be used."""
        if why:
            self._out.write(remark(why) + "\n")


def _told(replay: Replay, end: Conclusion) -> Iterator[tuple[Literal["error", "warning"], str, str]]:
    """What is to be said, of which property; of the recording as a whole where that is empty."""
    for text in end.unusable:
        yield "error", "", text
    for name, state in replay.states().items():
        if state["violations"]:
            yield "error", name, _violation(replay, name, state)
        elif not end.unusable and (reason := end.unjudged.get(name.removesuffix(" (arrival)"))):
            yield "error", name, f"was not judged: {reason}"
    severity: Literal["error", "warning"] = "error" if end.status == UNJUDGED and end.strict else "warning"
    for text in end.doubts:
        yield severity, "", text


def _violation(replay: Replay, name: str, state: dict[str, Any]) -> str:
    lines = episode_lines(replay, name)
    return f"{violated_text(state, len(lines))}: {lines[0]}" if lines else violated_text(state, 0)
