"""rtamt's monitor of one formula, behind the engine protocol: a verdict is the sign of its robustness."""

from __future__ import annotations

from typing import Any

from rtamt.syntax.node.ltl.iff import Iff as IffNode
from rtamt.syntax.node.ltl.xor import Xor as XorNode
from rtamt.syntax.node.stl.timed_historically import TimedHistorically
from rtamt.syntax.node.stl.timed_once import TimedOnce
from rtamt.syntax.node.stl.timed_since import TimedSince

from oracle_server.core.atoms import Matches
from oracle_server.core.explanation import Reason, Why
from oracle_server.core.formula.parse import Time
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.stl.numbers import nodes
from oracle_server.engines.stl.parse import Stl, read_stl
from oracle_server.engines.stl.windows import Historically, Iff, Once, Position, Since, Xor

_TIMED = {TimedOnce: Once, TimedHistorically: Historically, TimedSince: Since}


class StlEngine:
    """The state of one formula in one session.

    A sample is a step at which every signal of the formula has a number. At other steps nothing is known, and the
    monitor stays as it was.
    """

    def __init__(self, text: str, time: Time = "steps") -> None:
        """Raises `FormulaError` where the text is no formula."""
        stl = read_stl(text, time)
        self._text, self._timed = text, time == "seconds"
        self._names = tuple(stl.signals)
        self._clock = Position()
        self._monitor, self._numbers = _monitor(stl, self._clock), stl.numbers
        self._samples = 0
        self._values: dict[str, float] = {}
        self.robustness: float | None = None
        """How far the formula is from changing its truth at the last step, None where that is not known."""
        self.begun = False
        """Whether a step has had all signals."""

    def step(self, time: int, matches: Matches) -> Outcome:
        """Judge the next step. Robustness 0 is unknown, since rtamt has the same for `<` and `<=`."""
        self.robustness = None
        self.begun = self.begun or all(matches)
        sample = self._sample(matches)
        if sample is None:
            return Outcome.UNKNOWN
        self._samples += 1
        self._clock.now = time if self._timed else self._samples
        self.robustness = robustness = self._monitor.update(self._samples, sample) + 0.0  # not -0.0
        if robustness > 0:
            return Outcome.CURRENTLY_TRUE
        return Outcome.CURRENTLY_FALSE if robustness < 0 else Outcome.UNKNOWN

    def explain(self, past: Past = NO_PAST) -> Why:  # noqa: ARG002 -- the last sample is enough
        """The robustness, and the signals at the last step."""
        robustness = self.robustness or 0.0
        reason = Reason(self._text, holds=robustness > 0, text=f"robustness {robustness:g}")
        return Why(reason.holds, dict(self._values), 0, (reason,))

    def _sample(self, matches: Matches) -> list[tuple[str, float]] | None:
        try:
            values = {name: float(match[0]) for name, match in zip(self._names, matches, strict=True) if match}
            if len(values) < len(self._names):
                return None
            numbers = {name: number(values) for name, number in self._numbers.items()}
        except (ValueError, ArithmeticError):
            return None  # a signal is a text or a boolean, or there is no such number
        self._values = values
        return [*values.items(), *numbers.items()]


def _monitor(stl: Stl, clock: Position) -> Any:
    """What rtamt makes of a formula, with an operator a node: it shares one among equal parts, to see samples twice."""
    root = stl.root
    bounds = {}
    for number, node in enumerate(nodes(root)):
        if node.children:
            node.name = str(number)
        if type(node) in _TIMED:
            bounds[node.name] = (node.begin, node.end)
            node.begin = node.end = 0  # else rtamt makes room for its own window
    ast = stl.specification.ast
    ast.specs.append(root)
    ast.out_var, ast.out_var_field = "out", ""
    ast.var_object_dict["out"] = 0.0
    monitor = stl.specification.online_interpreter
    monitor.set_ast(ast)
    for node in nodes(root):
        if type(node) in _TIMED:
            monitor.online_operator_dict[node.name] = _TIMED[type(node)](clock, *bounds[node.name])
        elif isinstance(node, IffNode | XorNode):
            monitor.online_operator_dict[node.name] = Iff() if isinstance(node, IffNode) else Xor()
    return monitor
