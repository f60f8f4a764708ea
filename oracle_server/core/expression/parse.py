"""Text to tree, by one function a rank of operators, from the loosest to the tightest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from oracle_server.core.errors import ExpressionError
from oracle_server.core.expression import tree
from oracle_server.core.expression.cost import MAX_NAMES, MAX_NESTING
from oracle_server.core.expression.functions import FUNCTIONS, LOOPS, MODULES, of_module, unknown_function
from oracle_server.core.expression.patterns import unreadable
from oracle_server.core.expression.slips import (
    NO_FIELDS,
    NO_MESSAGE,
    compared,
    is_foreign,
    missing,
    no_power,
    unexpected,
    unknown_name,
)
from oracle_server.core.expression.tokens import Token, number_value, refusal, text_value, tokens
from oracle_server.core.expression.tree import Node

_WORDS = {"true": True, "false": False, "null": None}
KEYWORDS = frozenset({*_WORDS, "in", "msg"})
"""Names that stand for something in expressions: no signal is meant by them."""
_COMPARE = frozenset({"<", "<=", ">", ">=", "==", "!=", "in"})


def parse(text: str, variables: Sequence[str] = (), *, signals: bool = False) -> Node:
    """Read an expression over `msg` and `variables`, or `signals`. Raises `ExpressionError` with line and column."""
    parser = _Parser(text, variables, signals=signals)
    node = parser.choice()
    parser.ends()
    level = [node]
    for _ in range(MAX_NESTING):
        level = [child for each in level for child in tree.children(each)]
        if not level:
            return node
    raise ExpressionError(f"the expression is nested more than {MAX_NESTING} deep")


class _Parser:
    def __init__(self, text: str, variables: Sequence[str], *, signals: bool) -> None:
        self._text = text
        self._signals = signals
        self._tokens = tokens(text)
        self._at = 0
        self._open: list[Token] = []
        self._variables = list(variables)
        self._depth = 0

    def ends(self) -> None:
        if self._next.kind != "end":
            raise self._unexpected()

    def choice(self) -> Node:
        first = self._either()
        start, cases = first.start, []
        while self._takes("?"):
            value = self._either()
            if self._next.text == "?":
                raise self._refused(self._next, "a choice inside of a choice has to stand in parentheses")
            if not self._takes(":"):
                raise self._refused(
                    self._next, "a choice has two values, as in `test ? value : otherwise`; `:` is missing"
                )
            cases.append((first, value))
            first = self._either()
        return tree.Choice(tuple(cases), first, start, first.end) if cases else first

    def _either(self) -> Node:
        parts = [self._both()]
        while self._takes("||"):
            parts.append(self._both())
        return _joined("||", parts)

    def _both(self) -> Node:
        parts = [self._comparison()]
        while self._takes("&&"):
            parts.append(self._comparison())
        return _joined("&&", parts)

    def _comparison(self) -> Node:
        left = self._sum()
        self._check_words(left)
        if not self._compares():
            return left
        mark = self._pop().text
        right = self._sum()
        if self._compares():
            hint = "comparisons in a row have to stand in parentheses; for a range write `1 < msg.x && msg.x < 3`"
            raise self._refused(self._next, hint)
        return tree.Compare(mark, left, right, left.start, right.end)

    def _sum(self) -> Node:
        first, rest = self._product(), []
        while self._next.kind == "mark" and self._next.text in ("+", "-"):
            rest.append((self._pop().text, self._product()))
        return tree.Chain(first, tuple(rest), first.start, rest[-1][1].end) if rest else first

    def _product(self) -> Node:
        first, rest = self._unary(), []
        while self._next.kind == "mark" and self._next.text in ("*", "/", "%"):
            rest.append((self._pop().text, self._unary()))
        return tree.Chain(first, tuple(rest), first.start, rest[-1][1].end) if rest else first

    def _check_words(self, left: Node) -> None:
        """Refuse a comparison of another language behind an operand."""
        texts = [token.text for token in self._tokens[self._at : self._at + 3]]
        words = 2 if texts[:2] in (["is", "not"], ["not", "in"]) else 1
        message = compared(
            " ".join(texts[:words]), self._text[left.start : left.end], "".join(texts[words : words + 1])
        )
        if message is not None:
            raise self._refused(self._next, message)

    def _check_power(self, base: Node) -> None:
        if self._next.text in ("**", "^"):
            exponent = self._tokens[self._at + 1].text
            raise self._refused(self._next, no_power(self._next.text, self._text[base.start : base.end], exponent))

    def _unary(self) -> Node:
        token = self._next
        if token.kind != "mark" or token.text not in ("!", "-"):
            return self._value()
        self._pop()
        self._deeper(token)
        inner = self._unary()
        self._depth -= 1
        if token.text == "-" and isinstance(inner, tree.Literal) and type(inner.value) in (int, float):
            return tree.Literal(-inner.value, token.start, inner.end)  # type: ignore[operator]
        return tree.Unary(token.text, inner, token.start, inner.end)

    def _value(self) -> Node:
        node = self._primary()
        while True:
            if self._takes("."):
                node = self._member(node)
            elif self._next.text == "[" and self._next.kind == "mark":
                node = self._index(node)
            else:
                self._check_power(node)
                return node

    def _member(self, node: Node) -> Node:
        name = self._pop()
        if name.kind != "name":
            told = "a text is the name of a field as in msg['name']; " if name.kind == "text" else ""
            index = "; an element is written msg.list[0]" if name.kind == "number" else ""
            raise self._refused(name, f"{told}the name of a field is missing after `.`{index}")
        if self._next.text == "(" and self._next.kind == "mark":
            return self._loop(node, name) if name.text in LOOPS else self._method(node, name)
        return self._field(node, name.text, name.start, name.end)

    def _field(self, node: Node, name: str, place: int, end: int) -> Node:
        if self._signals and isinstance(node, tree.Path):
            raise refusal(self._text, place, NO_FIELDS)
        if not isinstance(node, tree.Path):
            return tree.Field(node, name, place, node.start, end)
        if len(node.names) == MAX_NAMES:
            raise refusal(self._text, place, f"a path has at most {MAX_NAMES} names")
        return tree.Path((*node.names, name), (*node.places, place), node.start, end)

    def _index(self, node: Node) -> Node:
        opened = self._opens()
        index = self.choice()
        end = self._closes(opened, "]")
        if isinstance(index, tree.Literal) and isinstance(index.value, str):
            return self._field(node, index.value, index.start, end)
        return tree.Index(node, index, node.start, end)

    def _method(self, node: Node, name: Token) -> Node:
        function = FUNCTIONS.get(name.text)
        if function is None:
            raise self._refused(name, unknown_function(name.text))
        arguments, end = self._arguments()
        if not function.own and not (name.text == "size" and not arguments):
            raise self._refused(name, f"'{name.text}' takes its value in parentheses: write `{function.usage}`")
        return self._called(name, (node, *arguments), node.start, end)

    def _called(self, name: Token, arguments: tuple[Node, ...], start: int, end: int) -> Node:
        function = FUNCTIONS[name.text]
        if not function.least <= len(arguments) <= function.most:
            raise self._refused(name, f"'{name.text}' is written `{function.usage}`")
        if name.text == "matches":
            self._check_pattern(arguments[1])
        return tree.Call(name.text, arguments, start, end)

    def _check_pattern(self, pattern: Node) -> None:
        told: str | None = "the pattern of 'matches' has to be written out, as in msg.text.matches('^map_[0-9]+$')"
        if isinstance(pattern, tree.Literal) and isinstance(pattern.value, str):
            told = unreadable(pattern.value)
        if told is not None:
            raise refusal(self._text, pattern.start, told)

    def _loop(self, of: Node, kind: Token) -> Node:
        opened = self._opens()
        variable = self._pop()
        wanted = f"write `msg.list.{kind.text}(x, x > 0)`"
        if variable.kind != "name" or variable.text in (*_WORDS, "in") or self._next.text != ",":
            raise self._refused(variable, f"'{kind.text}' begins with a name for the element: {wanted}")
        if variable.text == "msg":
            raise self._refused(variable, f"the name of the element can't be called msg: {wanted}")
        self._pop()
        self._variables.append(variable.text)
        body, when = self.choice(), None
        if kind.text == "map" and self._takes(","):
            when, body = body, self.choice()
        end = self._closes(opened, ")")
        self._variables.pop()
        return tree.Loop(kind.text, of, variable.text, body, when, of.start, end)

    def _arguments(self) -> tuple[tuple[Node, ...], int]:
        opened = self._opens()
        found: list[Node] = []
        while not (not found and self._next.text == ")"):
            found.append(self.choice())
            if not self._takes(","):
                break
        return tuple(found), self._closes(opened, ")")

    def _primary(self) -> Node:
        token = self._next
        if token.kind == "text":
            self._pop()
            return tree.Literal(text_value(self._text, token), token.start, token.end)
        if token.kind == "number":
            self._pop()
            return tree.Literal(number_value(self._text, token), token.start, token.end)
        if token.kind == "name" and token.text != "in":
            self._pop()
            return self._name(token)
        if token.text == "(":
            opened = self._opens()
            inner = self.choice()
            return replace(inner, start=opened.start, end=self._closes(opened, ")"))
        if token.text == "[":
            return self._list()
        if token.text == "{":
            return self._map()
        raise self._refused(token, missing(token, self._before))

    def _name(self, name: Token) -> Node:
        before = self._tokens[self._at - 2] if self._at > 1 else None
        if self._next.text == "(" and self._next.kind == "mark":
            return self._call(name)
        if name.text in self._variables:
            return tree.Variable(name.text, name.start, name.end)
        if name.text == "msg":
            return self._message(name)
        if name.text in _WORDS:
            return tree.Literal(_WORDS[name.text], name.start, name.end)
        if name.text in ("b", "B", "rb", "br") and self._next.kind == "text" and self._next.start == name.end:
            hint = "expressions have no bytes; in a message they are a text in base64, as in 'AQID'"
            raise self._refused(name, hint)
        if name.text in MODULES and self._next.text in (".", ":"):
            behind = (t for t in self._tokens[self._at :] if t.text not in (".", ":"))
            raise self._refused(name, of_module(name.text, next(behind).text))
        if self._next.text == "=" and before is None:
            told = (
                f"the name of a signal stands before the `:`, as in `{name.text}: msg.field`; leave `{name.text} =` out"
            )
            raise self._refused(name, told)
        if name.text in ("f", "F") and self._next.kind == "text" and self._next.start == name.end:
            raise self._refused(
                name, "a text has no fields in it; put texts together by `+`, as in 'a' + string(msg.x)"
            )
        return self._signal(name, before)

    def _message(self, name: Token) -> Node:
        if self._signals:
            raise self._refused(name, NO_MESSAGE)
        return tree.Path((), (), name.start, name.end)

    def _signal(self, name: Token, before: Token | None) -> Node:
        if self._signals and not is_foreign(name.text):
            return tree.Path((name.text,), (name.start,), name.start, name.end)
        is_compared = before is not None and before.text in ("==", "!=", "=", "is")
        path = [name.text]
        for token in self._tokens[self._at :]:
            if token.text not in (".", ":") and token.kind != "name":
                break
            path += [token.text] if token.kind == "name" else []
        raise self._refused(name, unknown_name(path, self._variables, compared=is_compared))

    def _call(self, name: Token) -> Node:
        function = FUNCTIONS.get(name.text)
        if name.text in ("and", "or", "not", "if", "is"):
            raise self._refused(name, missing(name, None))
        if name.text == "has":
            return self._has(name)
        if function is None:
            raise self._refused(name, unknown_function(name.text))
        if function.own:
            raise self._refused(name, f"'{name.text}' stands behind the text: write `{function.usage}`")
        arguments, end = self._arguments()
        return self._called(name, arguments, name.start, end)

    def _has(self, name: Token) -> Node:
        arguments, end = self._arguments()
        match arguments:
            case [tree.Path(names=[_, *_]) | tree.Field() | tree.Index() as of]:
                return tree.Has(of, name.start, end)
        wanted = "a signal, as in has(speed)" if self._signals else "a field, as in has(msg.field)"
        raise self._refused(name, f"'has' asks for {wanted}")

    def _list(self) -> Node:
        opened = self._opens()
        found: list[Node] = []
        while self._next.text != "]" or self._next.kind != "mark":
            found.append(self.choice())
            if not self._takes(","):
                break
        return tree.ListOf(tuple(found), opened.start, self._closes(opened, "]"))

    def _map(self) -> Node:
        opened = self._opens()
        keys: list[str] = []
        values: list[Node] = []
        while self._next.text != "}" or self._next.kind != "mark":
            key = self._pop()
            if key.kind != "text" or not self._takes(":"):
                raise self._refused(key, "a map is written {'name': value}, with its names as texts")
            keys.append(text_value(self._text, key))
            values.append(self.choice())
            if not self._takes(","):
                break
        return tree.MapOf(tuple(keys), tuple(values), opened.start, self._closes(opened, "}"))

    @property
    def _next(self) -> Token:
        return self._tokens[self._at]

    @property
    def _before(self) -> Token | None:
        return self._tokens[self._at - 1] if self._at else None

    def _pop(self) -> Token:
        token = self._next
        self._at += token.kind != "end"
        return token

    def _takes(self, mark: str) -> bool:
        found = self._next.kind == "mark" and self._next.text == mark
        self._at += found
        return found

    def _compares(self) -> bool:
        return self._next.kind in ("mark", "name") and self._next.text in _COMPARE

    def _opens(self) -> Token:
        token = self._pop()
        self._deeper(token)
        self._open.append(token)
        return token

    def _closes(self, opened: Token, mark: str) -> int:
        token = self._next
        if not self._takes(mark):
            raise self._unexpected()
        self._depth -= 1
        self._open.remove(opened)
        return token.end

    def _deeper(self, token: Token) -> None:
        self._depth += 1
        if self._depth > MAX_NESTING:
            raise self._refused(token, f"the expression is nested more than {MAX_NESTING} deep")

    def _unexpected(self) -> ExpressionError:
        opened = self._open[-1] if self._open else None
        token = self._next
        at = opened if token.kind == "end" and opened is not None else token
        after = self._tokens[self._at + 1] if token.kind != "end" else None
        return self._refused(at, unexpected(token, self._before, opened, after))

    def _refused(self, token: Token, message: str) -> ExpressionError:
        return refusal(self._text, token.start, message)


def _joined(mark: str, parts: list[Node]) -> Node:
    return parts[0] if len(parts) == 1 else tree.Joined(mark, tuple(parts), parts[0].start, parts[-1].end)
