"""Expressions that could end the process or keep it busy for ever: refused, or evaluated and over."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

PROJECT = """
import resource, sys, threading
from oracle_server.core.errors import ExpressionError
from oracle_server.core.signals import Projection

def project(text):
    try:
        Projection({"v": text})({"a": 1, "b": True, "s": "x", "l": list(range(4_000)), "m": {"a": {"a": 1}}})
    except ExpressionError:
        pass
    done.append(text)

done = []
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
project(sys.argv[1])
thread = threading.Thread(target=project, args=(sys.argv[1],))  # a thread's stack may be smaller
thread.start()
thread.join()
sys.exit(len(done) != 2)
"""
NO_END = 20
"""Seconds after which an evaluation counts as one that does not end."""


@pytest.mark.parametrize(
    "expression",
    [
        pytest.param("!" * 4_000 + "true", id="not"),
        pytest.param("-" * 4_000 + "1", id="minus"),
        pytest.param("- " * 2_000 + "msg.a", id="minus apart"),
        pytest.param("!(" * 64 + "true" + ")" * 64, id="not in parentheses"),
        pytest.param("msg" + ".a" * 1_300, id="path"),
        pytest.param("msg" + "['a']" * 800, id="index"),
        pytest.param("msg.l" + "[0]" * 1_300, id="list index"),
        pytest.param("(((", id="open"),
        pytest.param("(" * 64 + "msg.a" + ")" * 64, id="parentheses"),
        pytest.param("(" * 4_000, id="open for ever"),
        pytest.param("[" * 64 + "]" * 64, id="lists"),
        pytest.param("{1:" * 64 + "1" + "}" * 64, id="maps"),
        pytest.param("[" * 4_000, id="lists for ever"),
        pytest.param("msg.a+" * 680 + "1", id="sum"),
        pytest.param("1+" * 2_047 + "1", id="sum of numbers"),
        pytest.param("1-" + "-" * 4_000 + "1", id="difference"),
        pytest.param("msg.b&&" * 580 + "true", id="and"),
        pytest.param("true||false&&" * 300 + "true", id="or and and"),
        pytest.param("1<" * 2_000 + "1", id="comparison"),
        pytest.param("1 in " * 800 + "[1]", id="in"),
        pytest.param("true?1:" * 580 + "2", id="else if"),
        pytest.param("true?" * 580 + "1" + ":2" * 580, id="if if"),
        pytest.param("(msg.b?" * 60 + "1" + ":2)" * 60, id="if in parentheses"),
        pytest.param("size(" * 63 + "msg.l" + ")" * 63, id="calls"),
        pytest.param("msg.l" + ".size()" * 580, id="chained calls"),
        pytest.param("'" * 4_096, id="quotes"),
        pytest.param('"""' * 1_365, id="triple quotes"),
        pytest.param("'a" + "\\" * 4_000, id="backslashes"),
        pytest.param("'a'.matches('" + "(a*)*" * 700 + "b')", id="regular expression"),
        pytest.param("'a'.matches('(((a{99}){99}){99}){99}')", id="repetition"),
        pytest.param("msg.l" + ".map(x, x)" * 400, id="comprehensions in a row"),
        pytest.param("[msg.s]" + ".map(x, x + x)" * 60, id="doubling"),
        pytest.param("msg.l.map(x, msg.l" + " + msg.l" * 400 + ").size()", id="lists of lists"),
        pytest.param("msg.l" + ".filter(x, true)" * 200, id="filters in a row"),
        pytest.param("msg.l.map(x, [" + "1," * 1_900 + "])", id="a list for each"),
        pytest.param("msg.l.map(x, {" + ",".join(f"{i}:0" for i in range(500)) + "})", id="a map for each"),
        pytest.param("[" + "1," * 900 + "].map(x, [" + "1," * 900 + "])", id="a list for each of a list"),
        pytest.param("[" + "1," * 900 + "].map(x, msg.l)", id="what is read for each of a list"),
        pytest.param("msg.l" + " + msg.l" * 20 + " == []", id="a list twenty times"),
        pytest.param(
            r"msg.l.all(x, r'\' != '' && " + "msg.l.all(x, " * 6 + "true" + ")" * 6 + r" && r'\' != '')",
            id="comprehensions hidden in a raw string",
        ),
    ],
)
def test_survived(expression: str) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-B", "-c", PROJECT, expression]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=NO_END, check=False)
    assert done.returncode == 0, done.stderr[-500:]
