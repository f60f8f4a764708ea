"""Published examples of other tools, in this language: the same events have the verdicts that their semantics gives.

MonPoly: `examples/` of its repository. rtamt: `examples/basic/` of its repository. TeSSLa: tutorial and quick start.
RTLola: the operators of its sliding windows. A time-point of several events is several steps of one time here, in the
order in which they stand.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from oracle_server.core.verdicts import record
from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.specfiles.load import parse_spec

Event = tuple[float, str, dict[str, Any]]


class Published(NamedTuple):
    """An example: the streams, what stands before the formula, the formula, events, and the violations to find."""

    topics: dict[str, tuple[str, ...]]
    formula: str
    events: list[Event]
    expected: list[tuple[float, list[int]]]
    """Times in seconds, and the steps that each is about; of one that waits for nothing none."""
    more: str = ""
    time: str = "seconds"
    at_end: str = "ignore"


DAY = 86_400
REVIEWED: list[Event] = [
    (1307532861, "approve", {"r": 152}),
    (1307955600, "approve", {"r": 163}),
    (1307955600, "publish", {"r": 160}),
    (1308477599, "approve", {"r": 187}),
    (1308477599, "publish", {"r": 163}),
    (1308477599, "publish", {"r": 152}),
    (1308477609, "approve", {"r": 163}),
    (1308477609, "publish", {"r": 169}),
    (1308477609, "publish", {"r": 150}),
    (1308477610, "approve", {"r": 150}),
    (1308600000, "approve", {"r": 169}),
]
"""MonPoly's rv11.log: report 160 is never approved, 163 and 150 within a day of their publication, 169 after a day."""
APPROVED_LATER = "forall[r]. {topic: /publish, r: *r} -> eventually[24h:168h] {topic: /approve, r: *r}"

MANAGED: list[Event] = [
    (1307532861, "mgr_s", {"m": "Mallory", "a": "Alice"}),
    (1307532861, "mgr_s", {"m": "Merlin", "a": "Bob"}),
    (1307532861, "mgr_s", {"m": "Merlin", "a": "Charlie"}),
    (1307532861, "approve", {"m": "Mallory", "f": 152}),
    (1307955600, "mgr_f", {"m": "Merlin", "a": "Charlie"}),
    (1307955600, "approve", {"m": "Merlin", "f": 163}),
    (1307955600, "publish", {"a": "Alice", "f": 160}),
    (1308477599, "approve", {"m": "Merlin", "f": 187}),
    (1308477599, "publish", {"a": "Bob", "f": 163}),
    (1308477600, "publish", {"a": "Alice", "f": 163}),
    (1308477601, "approve", {"m": "Merlin", "f": 1}),
    (1308477602, "publish", {"a": "Charlie", "f": 163}),
]
"""MonPoly's rv11b.log, its last time-point drawn apart: only Bob's manager has approved what he publishes."""

TRANSACTIONS: list[Event] = [
    (0, "trans", {"c": "x", "t": 1, "a": 2500}),
    (1, "trans", {"c": "y", "t": 2, "a": 1500}),
    (2, "trans", {"c": "x", "t": 3, "a": 9000}),
    (2, "report", {"t": 3}),
    (5, "report", {"t": 1}),
    (8, "report", {"t": 3}),
    (20, "trans", {"c": "z", "t": 4, "a": 2001}),
    (26, "report", {"t": 4}),
]

EXAMPLES = {
    "monpoly_rv11": Published(
        {"publish": ("r",), "approve": ("r",)}, APPROVED_LATER, REVIEWED, [(1307955600 + 7 * DAY, [3])]
    ),
    "monpoly_rv11_at_the_end": Published(
        {"publish": ("r",), "approve": ("r",)}, APPROVED_LATER, REVIEWED,
        [(1307955600 + 7 * DAY, [3]), (1308600000, [5, 6, 9])], at_end="violated",
    ),
    "monpoly_rv11b": Published(
        {"publish": ("a", "f"), "approve": ("m", "f"), "mgr_s": ("m", "a"), "mgr_f": ("m", "a")},
        "forall[a, f]. {topic: /publish, a: *a, f: *f} -> "
        "exists[m]. once[:168h] (manages(m, a) and {topic: /approve, m: *m, f: *f})",
        MANAGED, [(1307955600, []), (1308477600, []), (1308477602, [])],
        more="define: {'manages(m, a)': 'not {topic: /mgr_f, m: *m, a: *a} since {topic: /mgr_s, m: *m, a: *a}'}",
    ),
    "monpoly_p2": Published(  # reported within [1, 6) of whole seconds
        {"trans": ("c", "t", "a"), "report": ("t",)},
        "forall[t]. {topic: /trans, t: *t, a > 2000} -> eventually[1:5] {topic: /report, t: *t}",
        TRANSACTIONS, [(7, [3]), (25, [7])],
    ),
    "monpoly_p3": Published(  # authorised within [2, 21) before
        {"trans": ("c", "t", "a"), "auth": ("e", "t")},
        "forall[t]. {topic: /trans, t: *t, a > 2000} -> exists[e]. once[2:20] {topic: /auth, e: *e, t: *t}",
        [(0, "auth", {"e": 1, "t": 1}), (1, "trans", {"c": 1, "t": 1, "a": 3000}), (2, "auth", {"e": 2, "t": 2}),
         (4, "trans", {"c": 1, "t": 1, "a": 3000}), (5, "trans", {"c": 1, "t": 9, "a": 100}),
         (22, "trans", {"c": 1, "t": 2, "a": 3000}), (23, "trans", {"c": 1, "t": 2, "a": 3000})],
        [(1, []), (23, [])],
    ),
    "monpoly_sum_by_client": Published(  # less than 500 in [0, 30] of whole seconds
        {"transaction": ("client", "amount")}, "not {topic: /transaction, spent >= 500}",
        [(0, "transaction", {"client": "ann", "amount": 300}), (10, "transaction", {"client": "bob", "amount": 499}),
         (30, "transaction", {"client": "ann", "amount": 200}), (31, "transaction", {"client": "ann", "amount": 299}),
         (32, "transaction", {"client": "ann", "amount": 1})],
        [(30, []), (32, [])], more="derive: {spent: {sum: amount, over: 31s, by: client}}",
    ),
    "rtamt_online": Published(  # a + b >= -2, whose robustness is 122, 3, -10
        {"ab": ("a", "b")}, "{total >= -2}",
        [(0, "ab", {"a": 100.0, "b": 20.0}), (1, "ab", {"a": -1.0, "b": 2.0}), (2, "ab", {"a": -2.0, "b": -10.0})],
        [(2, [])], more="derive: {total: a + b}", time="steps",
    ),
    "rtamt_basic": Published(  # always F[1:2] a > 0, about the first sample false once the third is there
        {"ab": ("a", "b")}, "eventually[1:2] {a > 0}",
        [(0, "ab", {"a": 100.0, "b": 20.0}), (1, "ab", {"a": -1.0, "b": 2.0}), (2, "ab", {"a": -2.0, "b": -10.0})],
        [(2, [1])], time="steps",
    ),
    "tessla_temperature": Published(  # unsafe: < 3 or > 8
        {"temperature": ("t",)}, "not ({t < 3} or {t > 8})",
        [(n, "temperature", {"t": t}) for n, t in enumerate((6, 2, 1, 5, 9), 1)], [(2, []), (5, [])], time="steps",
    ),
    "tessla_too_big": Published(  # the sums of x and y, and whether they differ by 10 or more
        {"xs": ("x",), "ys": ("y",)}, "not {diff >= 10} and not {diff <= -10}",
        [(10, "xs", {"x": 2}), (17, "xs", {"x": 1}), (19, "ys", {"y": 4}), (37, "xs", {"x": 7}), (45, "xs", {"x": 6}),
         (78, "ys", {"y": 9}), (98, "xs", {"x": 2})],
        [(45, [])],
        more="derive: {sum_x: {sum: x, over: 24h}, sum_y: {sum: y, over: 24h}, diff: sum_x - sum_y}", time="steps",
    ),
    "rtlola_window": Published(  # the average of the last 3 s, which time alone changes
        {"velocity": ("v",)}, "not {average > 10}",
        [(1, "velocity", {"v": 8}), (2, "velocity", {"v": 12}), (6, "velocity", {"v": 3})],
        [(4, [])], more="derive: {average: {mean: v, over: 3s}}",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_published_example_has_the_verdicts_of_its_tool(name: str, tmp_path: Path) -> None:
    example = EXAMPLES[name]
    streams = "\n".join(
        f"  - {{topic: /{topic}, signals: {{{', '.join(f'{s}: msg.{s}' for s in signals)}}}}}"
        for topic, signals in example.topics.items()
    )
    text = f"""id: {name}
streams:
{streams}
{example.more}
properties:
  - id: p
    time: {example.time}
    at_end: {example.at_end}
    formula: '{example.formula}'
"""
    loaded = parse_spec(text, "published.yaml")
    lines = [
        {"stream": f"/{topic}", "stamp": int(time * 10**9) + 10**9, "arrived": int(time * 10**9) + 10**9, "data": data}
        for time, topic, data in example.events
    ]
    path = tmp_path / "trace.jsonl"
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    replay = Replay(loaded.spec, open_recording(path, loaded.spec))
    records = [record(row, verdict) for row in replay for verdict in row.verdicts]
    found = [((r["stamp"] - 10**9) // 10**9, [a["step"] for a in r["about"]]) for r in records if r["violation"]]
    assert found == example.expected
