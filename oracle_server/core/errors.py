"""What can be wrong: one tree, whose texts are fit to be shown to people.

- `OracleError`
    - `FormulaError`: a formula that can't be read, with its line and column
    - `ExpressionError`: an expression of a spec that can't be read or is not allowed, with its line and column
    - `SpecError`: a spec that is refused, with every problem found
    - `TraceError`: a recording that can't be used
        - `NotReadError`: one that the system does not let be read, whatever is in it
    - `EngineError`: an engine that can't judge any more
    - `HistoryError`: a history that can't be opened or read
        - `UnpreparedError`: a session that an older version has written, and whose timeline is not made yet
        - `UnansweredError`: a database that could not be reached, or ended the connection; the next try may succeed

and, where they are raised:

- `specfiles`: `UnknownSpecError`; `SpecChangedError`, where another text was expected; `GraphError`, a dump of a ROS
  graph that can't be read; `ConfigError`, `UntranslatableError`, `UnfollowableError`, `UnreadableFormulaError` and
  `FutureError`, of what ROSMonitoring was configured with; `FretError`, of a file of FRET's or Ogma's; `HplError` and
  `NoCounterpartError`, of one in HPL, and of what a spec can't say of it; `DiagramError`, of a state diagram;
  `MachineError`, of a machine of a spec; `NotWrittenError`, of a spec that was imported and can't be written
- `rostypes`: `TypesError`, definitions that can't be used; `DefinitionError`, one that can't be read, with its line
- `wire`: `WireError`, what is answered by an `error` frame
- `process`: `SettingsError`, `LogError`, `PidFileError`, `DaemonError`, `FilesError`; `WorkerError`, of a process
  beside the server
- `history`: `FormatError` and `FencedError`, each a `HistoryError`: of a format that this version does not read, of a
  server whose sessions another one has taken over
- `remote`: `UnreachableError`, `OtherEventError`, of an oracle elsewhere
- `history.copying`: `CopyError`, a `HistoryError`: of a history that can't be copied, or not to where it was to go
- `review`: `NoExplanationError`; `NowhereError`, of a place in a session that there is not
- `sessions`: `SessionExistsError`, `SessionNameError`, `SessionStaysOpenError`; `OtherServerError`, of a session that
  another server has
- `replay`: `DamagedError`, of a part of a recording; `UnreadDefinitionError`, of a type that it defines;
  `NoRoomError`, of one that unpacks to more than the disk takes; `ResultsError`, of a table of results that can't be
  read or written; `RayError`, where Ray is not there
- `foxglove`: `FoxgloveError`, where nothing can be offered to Foxglove
- `jobs`: `UncheckedError`, of a spec; `CrowdedError`, where too much is wanted at once;
  `JudgeError`, `FullError`, `TooLargeError` and `UnwantedError`, of a recording that was sent
- `edge`: `TokenError`, `CertificateError`; `UndeclaredRouteError`, of a route that says not who may use it;
  `ListenError`, of an address that can't be listened at
- `embedded`: `EmbeddedError`, of an oracle in an adapter's process that can't be opened
- `server`: `ServerError`, a server that can't start
- `cli`: `ServerUnreachableError`; `InitError`, of a folder that can not be begun; `CutOffError`, of output that nobody
  reads any more
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal


class OracleError(Exception):
    """The root: its text is fit to be shown to a person as it is."""


class FormulaError(OracleError):
    """A formula that can't be read; `line` and `column` count from 1 in the formula's own text.

    `told`: the reason is a mistake elsewhere, of which that is said already.
    """

    def __init__(self, message: str, line: int = 1, column: int = 1, *, told: bool = False) -> None:
        super().__init__(message)
        self.message, self.line, self.column, self.told = message, line, column, told

    def __str__(self) -> str:
        return f"{self.line}:{self.column}: {self.message}"


class ExpressionError(OracleError):
    """An expression that can't be read or is not allowed; `line` and `column` count from 1 in its own text."""

    def __init__(self, message: str, line: int = 1, column: int = 1) -> None:
        super().__init__(message)
        self.message, self.line, self.column = message, line, column

    def __str__(self) -> str:
        return f"{self.line}:{self.column}: {self.message}"


def one_line(text: str) -> str:
    """A text as one line of printable characters, whatever it quotes."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


FindingKind = Literal["general", "vacuous", "unjudged", "type"]
"""What a finding is about.

- `vacuous`: a part of a formula that never holds, or never fails, whatever the messages say
- `unjudged`: what leaves a property unknown at some events, whatever the messages say
- `type`: a type, or what is read of its messages
- `general`: all else
"""


@dataclass(frozen=True, slots=True)
class SpecProblem:
    """One thing that is wrong with a spec.

    `path` is where it stands, as keys and list indexes; `within` is the line and column inside the text that
    stands there, from 1, where that is known; `first` is where something stands that is here a second time.
    """

    path: tuple[str | int, ...]
    message: str
    within: tuple[int, int] | None = None
    severity: Literal["error", "warning"] = "error"
    first: tuple[str | int, ...] | None = None
    kind: FindingKind = "general"


@dataclass(frozen=True, slots=True)
class Finding:
    """A problem with its place in a file; `line` and `column` count from 1."""

    file: str
    line: int
    column: int
    message: str
    severity: Literal["error", "warning"] = "error"
    kind: FindingKind = "general"

    def __str__(self) -> str:
        mark = "warning: " if self.severity == "warning" else ""
        return f"{self.file}:{self.line}:{self.column}: {mark}{one_line(self.message)}"


class SpecError(OracleError):
    """A spec that is refused, with everything that was found."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        super().__init__("\n".join(str(f) for f in findings))
        self.findings = tuple(findings)


class TraceError(OracleError):
    """A trace that can't be used."""


class NotReadError(TraceError):
    """A trace that the system does not let be read, whatever is in it: another time it may."""


class EngineError(OracleError):
    """An engine that can't judge any more: its verdicts are unknown from here on."""


class HistoryError(OracleError):
    """A history that can't be opened or read."""


class UnansweredError(HistoryError):
    """A database that could not be reached, or that ended the connection; the next try may succeed."""


class UnpreparedError(HistoryError):
    """A session that an older version has written, and whose timeline is not made yet."""
