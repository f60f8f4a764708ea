"""Reelay's discrete-time monitors behind the engine protocol.

Reelay gets fully parenthesised text printed from our tree, never a user's; each atom is a key of its own whose
truth we evaluate, and every update carries every key: reelay keeps the old value of a key that an update lacks, dies
on a formula that it can't parse, and reads some operators differently (`[0:0]`, quantified `historically`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

from oracle_server.core.atoms import Matches
from oracle_server.core.engine import outcome
from oracle_server.core.errors import EngineError
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.tree import (
    ALL_PAST,
    And,
    Atom,
    Bound,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Pre,
    Relation,
    Since,
    atoms,
    walk,
)
from oracle_server.core.verdicts import Outcome

MAX_VALUES = 2**20 - 8
"""Distinct values that one quantified variable may take: reelay has 2^20 codes and aliases silently beyond."""
MAX_BOUND = 2**24
"""Largest bound: reelay reads bounds as 32-bit floats, exact up to here."""
_FILLER = "-"
"""What a variable's key carries while its atom is false; no canonical value reads so."""


def demand() -> None:
    """Raises `EngineError` where reelay is not installed."""
    if find_spec("reelay") is None:
        raise EngineError(
            "`engine: reelay` and `both` need reelay, which is not installed: it is there for Linux; leave `engine` "
            "out, or write `engine: native`"
        )


def refusal(formula: Formula, time: str) -> str | None:
    """Why this engine can't judge a formula, None where it can."""
    if looks_ahead(formula):
        return "it waits for what comes, which the reelay engine can't; `engine: native` can"
    if time != "steps":
        return "the reelay engine judges `time: steps` only"
    if any(isinstance(node, Relation) for node in walk(formula)):
        return "it compares the values of variables, which the reelay engine can't; `engine: native` can"
    bounds = [n.bound for n in walk(formula) if isinstance(n, Once | Historically | Since)]
    if any(max(b.lower, b.upper or 0) > MAX_BOUND for b in bounds):
        return f"the reelay engine reads bounds up to {MAX_BOUND} exactly, and this formula has a larger one"
    return None


class ReelayEngine:
    """One reelay monitor; takes some 20 ms and 10 MB to make where the formula has quantifiers."""

    def __init__(self, formula: Formula, max_values: int = MAX_VALUES) -> None:
        """Raises `EngineError` where this engine can't judge the formula, or reelay is not installed."""
        demand()
        import reelay

        reason = refusal(formula, "steps")
        if reason:
            raise EngineError(reason)
        self._formula = formula
        self._max_values = max_values
        printer = _Printer(formula)
        self._monitor = reelay.discrete_timed_monitor(pattern=printer.text, condense=False)
        self._keys = printer.keys
        self._idle: dict[str, Any] = {}
        for key in self._keys:
            self._idle |= {key.flag: False, **dict.fromkeys(key.refs, _FILLER)}
        self._seen: dict[str, set[str]] = {name: set() for key in self._keys for name in key.variables}

    def step(self, time: int, matches: Matches) -> Outcome:  # noqa: ARG002 -- a step's time is its number here
        """Judge the next step. Raises `EngineError` once a variable has taken too many values."""
        update: dict[str, Any] = self._idle.copy()
        for key, match in zip(self._keys, matches, strict=True):
            if match is not None:
                update[key.flag] = True
                update.update(zip(key.refs, match, strict=True))
                for variable, place in key.uses:
                    self._count(variable, match[place])
        try:
            holds = self._monitor.update(update)["value"]
        except Exception as error:  # noqa: BLE001 -- whatever the native code raises, the engine's state is unknown
            raise EngineError(f"reelay failed: {error}") from None
        return outcome(self._formula, bool(holds))

    def _count(self, variable: str, value: str) -> None:
        seen = self._seen[variable]
        seen.add(value)
        if len(seen) > self._max_values:
            raise EngineError(
                f"a quantified variable has taken more than {self._max_values} different values, "
                "beyond which reelay confuses them"
            )


@dataclass(slots=True)
class _AtomKeys:
    """An atom's keys in every update: its truth, and a value for each of its refs.

    `uses` tells which of reelay's variables stand at which ref: an atom can stand under several quantifiers.
    """

    flag: str
    refs: tuple[str, ...]
    uses: set[tuple[str, int]] = field(default_factory=set)

    @property
    def variables(self) -> set[str]:
        return {variable for variable, _ in self.uses}


class _Printer:
    """Prints a formula for reelay, every quantified variable under a name of its own."""

    def __init__(self, formula: Formula) -> None:
        found = atoms(formula)
        self.keys = [
            _AtomKeys(f"a{i}", tuple(f"a{i}_{k}" for k in range(len(atom.refs)))) for i, atom in enumerate(found)
        ]
        self._of_atom = dict(zip(found, self.keys, strict=True))
        self._quantifiers = 0
        self.text = self._print(formula, {})

    def _print(self, node: Formula, names: dict[str, str]) -> str:  # noqa: C901, PLR0911, PLR0912 -- a case a node
        match node:
            case Atom():
                return self._atom(node, names)
            case Not(operand):
                return f"not ({self._print(operand, names)})"
            case Pre(operand):
                return f"pre ({self._print(operand, names)})"
            case Once(operand, Bound(0, 0)) | Historically(operand, Bound(0, 0)) | Since(_, operand, Bound(0, 0)):
                return f"({self._print(operand, names)})"
            case Once(operand, bound):
                return f"once{_bound(bound)} ({self._print(operand, names)})"
            case Historically(operand, bound):
                return f"not (once{_bound(bound)} (not ({self._print(operand, names)})))"
            case Since(left, right, bound):
                return f"({self._print(left, names)}) since{_bound(bound)} ({self._print(right, names)})"
            case And(left, right):
                return f"({self._print(left, names)}) and ({self._print(right, names)})"
            case Or(left, right):
                return f"({self._print(left, names)}) or ({self._print(right, names)})"
            case Implies(left, right):
                return f"({self._print(left, names)}) -> ({self._print(right, names)})"
            case Exists(variable, body):
                return self._quantified("exists", variable, body, names)
            case Forall(variable, body):
                return self._quantified("forall", variable, body, names)
            case _:
                raise AssertionError(node)  # see `refusal`

    def _atom(self, atom: Atom, names: dict[str, str]) -> str:
        key = self._of_atom[atom]
        variables = [names[variable] for _, variable in atom.refs]
        key.uses.update((variable, place) for place, variable in enumerate(variables))
        refs = "".join(f", {ref}: *{variable}" for ref, variable in zip(key.refs, variables, strict=True))
        return f"{{{key.flag}: true{refs}}}"

    def _quantified(self, word: str, variable: str, body: Formula, names: dict[str, str]) -> str:
        self._quantifiers += 1
        name = f"v{self._quantifiers}"
        text = self._print(body, {**names, variable: name})
        if not any(name in key.variables for key in self.keys):
            return text  # reelay dies of a variable that no atom uses, and `since[0:0]` can drop the last use
        return f"{word}[{name}]. ({text})"


def _bound(bound: Bound) -> str:
    if bound == ALL_PAST:
        return ""
    return f"[{bound.lower}:{'' if bound.upper is None else bound.upper}]"
