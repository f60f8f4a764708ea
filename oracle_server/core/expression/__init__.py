"""Expressions over `msg`, a message: read, checked before any message, and evaluated within a bound that is counted.

parse_expression(text) -> Expression            raises `ExpressionError`, with line and column
check_rows(expression, shape) -> [Problem]      the same of one that is to be a list, of which each element is a row
check_shape(expression, shape) -> [Problem]     what is wrong with it, for messages of a shape, or of any (None)
idle(expression) -> message or None             why it is the same at each message, where it reads nothing of them
result_kind(expression, shape) -> kind or None  what its signal is
results(expression, shape) -> each choice's     what is written out, or what is known of it
is_always_there(expression, shape) -> bool      whether its signal is never absent
certain(tree) -> names                          the fields without any of which it is absent
"""

from oracle_server.core.expression.check import Problem, check_rows, check_shape, result_kind
from oracle_server.core.expression.cost import MAX_ROWS, MAX_STEPS
from oracle_server.core.expression.expression import Expression, FieldPath, parse_expression, read, too_dear
from oracle_server.core.expression.idle import idle
from oracle_server.core.expression.parse import KEYWORDS
from oracle_server.core.expression.patterns import MAX_PATTERNS
from oracle_server.core.expression.reasons import absent_at_an_element, no_signal, reason, told
from oracle_server.core.expression.results import certain, is_always_there, results
from oracle_server.core.expression.spans import Span
from oracle_server.core.expression.static import no_field
from oracle_server.core.expression.stops import Absent, Failed
from oracle_server.core.expression.tree import Literal

__all__ = [
    "KEYWORDS",
    "MAX_PATTERNS",
    "MAX_ROWS",
    "MAX_STEPS",
    "Absent",
    "Expression",
    "Failed",
    "FieldPath",
    "Literal",
    "Problem",
    "Span",
    "absent_at_an_element",
    "certain",
    "check_rows",
    "check_shape",
    "idle",
    "is_always_there",
    "no_field",
    "no_signal",
    "parse_expression",
    "read",
    "reason",
    "result_kind",
    "results",
    "told",
    "too_dear",
]
