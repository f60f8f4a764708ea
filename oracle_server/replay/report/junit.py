"""The report of `replay` as JUnit XML, for continuous integration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import IO, Any
from xml.sax.saxutils import escape, quoteattr

from oracle_server.core.errors import one_line
from oracle_server.core.units import counted
from oracle_server.core.verdicts import Judged
from oracle_server.replay.conclusion import Conclusion, conclude, still_open
from oracle_server.replay.report.violated import episode_lines, violated_text
from oracle_server.replay.run import Replay

_MOST_SHOWN = 20
"""Episodes of one property that a JUnit report explains; all are counted."""


class JunitReport:
    """A test suite for each spec, a test case for each property: a failure if violated, an error if not judged."""

    def __init__(self, out: IO[str], several: bool) -> None:  # noqa: ARG002 -- a suite always has its name
        self._out = out
        self._suites: list[str] = []

    def judged(self, replay: Replay, judged: Judged) -> None:  # noqa: ARG002 -- as all of them
        """Keep nothing: episodes are known at the end."""
        replay.comparison.take()

    def ended(self, replay: Replay) -> None:
        """Add a suite."""
        end = conclude(replay)
        cases = [self._case(replay, end, name, state) for name, state in replay.states().items()]
        if end.strict and (end.doubts or end.warnings):
            lines = (*end.doubts, *end.warnings)
            lacks = f"not everything was judged, and --strict was given: {lines[0]}"
            cases.append(_of_recording(replay.spec.id, lacks, lines))
        wrong = {kind: sum(f"<{kind} " in case for case in cases) for kind in ("failure", "error")}
        counts = f'failures="{wrong["failure"]}" errors="{wrong["error"]}" skipped="0"'
        head = f'  <testsuite name={_attribute(replay.spec.id)} tests="{len(cases)}" {counts}>\n'
        self._suites.append(head + "".join(cases) + _said(replay, end) + "  </testsuite>\n")

    def finish(self, why: str = "") -> None:
        """Write all suites, and one in error where an input can't be used: an empty file is none that a CI reads."""
        if why:
            self._suites.append(
                '  <testsuite name="replay" tests="1" failures="0" errors="1" skipped="0">\n'
                f"{_of_recording('replay', why.splitlines()[0], why.splitlines())}  </testsuite>\n"
            )
        self._out.write('<?xml version="1.0" encoding="UTF-8"?>\n<testsuites>\n')
        self._out.write("".join(self._suites))
        self._out.write("</testsuites>\n")

    def _case(self, replay: Replay, end: Conclusion, name: str, state: dict[str, Any]) -> str:
        head = f"    <testcase classname={_attribute(replay.spec.id)} name={_attribute(name)}"
        inside = ""
        if state["violations"]:
            lines = episode_lines(replay, name)
            message = violated_text(state, len(lines))
            texts = "\n".join(escape(one_line(text)) for text in lines[:_MOST_SHOWN])
            inside = f"      <failure message={_attribute(message)}>{texts}</failure>\n"
        elif end.unusable:
            inside = f"      <error message={_attribute(end.unusable[0])}/>\n"
        elif reason := end.unjudged.get(name.removesuffix(" (arrival)")):
            unknown = f"{counted(state['unknown'], 'step')} could not be judged: " if state["unknown"] else ""
            message = f"{unknown}{reason}"
            inside = f"      <error message={_attribute(message)}/>\n"
        return f"{head}>\n{inside}    </testcase>\n" if inside else f"{head}/>\n"


def _of_recording(name: str, message: str, lines: Sequence[str]) -> str:
    """A case for what is no matter of one property: what a strict replay lacks, or an input that can't be used."""
    text = "\n".join(escape(one_line(line)) for line in lines)
    head = f'    <testcase classname={_attribute(name)} name="(recording)">\n'
    return f"{head}      <error message={_attribute(message)}>{text}</error>\n    </testcase>\n"


def _said(replay: Replay, end: Conclusion) -> str:
    """What is to be known of the recording, and what is left open."""
    told = (*still_open(replay), *end.doubts, *end.warnings, *end.remarks)
    lines = "\n".join(escape(one_line(text)) for text in told)
    return f"    <system-out>{lines}</system-out>\n" if lines else ""


def _attribute(text: str) -> str:
    return quoteattr(one_line(text))
