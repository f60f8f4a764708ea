"""What `check` says of properties that say how long nothing may come, and are judged at messages alone."""

from __future__ import annotations

import pytest

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec
from tests.strategies import SECOND

SPEC = """\
id: t
streams:
  - {{topic: /scan}}
  - {{topic: /odom, action: filter}}
  - {{topic: /mode, signals: {{mode: msg.data}}, hold: [mode]}}
  - {{topic: /limit, signals: {{limit: msg.data}}, hold: [limit]}}
derive:
  idle: {{age: '{{topic: /scan}}'}}
  often: {{rate: '{{topic: /scan}}', over: 2s}}
  lately: {{count: '{{topic: /scan}}', over: 2s}}
  last_ten: {{count: '{{topic: /scan}}', over: 10}}
  per_minute: often * 60
  few: per_minute < 300
  period: 1 / often
  period_ms: period * 1000
  gap: 1 / lately
  share: lately / (last_ten + 1)
  part: lately / (often + 1)
properties:
  - id: others
    formula: '{{topic: /odom}} -> {{idle: *, often: *}} or {{lately: *, last_ten: *}}'
    guards: [/odom]
    blame: any
  - {{id: p, {prop}}}
"""


AUTO = {"often": "rate", "many": "count"}


def told(prop: str) -> list[str]:
    found = parse_spec(SPEC.format(prop=prop), "s.yaml").warnings
    return [each.message for each in found if "silence is not told" in each.message]


@pytest.mark.parametrize(
    ("prop", "what"),
    [
        ("formula: '{idle <= 1}'", "idle"),
        ("formula: 'not {idle > 1}'", "idle"),
        ("formula: '{mode: AUTO} -> {idle < limit}'", "idle"),
        ("formula: '{mode: AUTO} -> not {limit < idle}'", "idle"),
        ("formula: 'not {often < 5}'", "often"),
        ("formula: '{idle > 1} -> {mode: STOP}'", "idle"),
        ("formula: '{lately >= 2} and {idle <= 1}'", "idle` and `lately"),
        ("pattern: 'always {idle <= 1}'", "idle"),
        ("requirement: 'The robot shall always satisfy {idle <= 1}'", "idle"),
    ],
)
def test_one_that_counts_steps_is_judged_at_messages_alone(prop: str, what: str) -> None:
    (found,) = told(prop)
    change = "change" if " and " in what else "changes"
    assert found.endswith(f"`{what}` {change} while no message comes, and steps are messages; write `time: seconds`")
    assert told(f"{prop}, time: seconds") == []
    assert told(f"{prop}, time: steps") == []


@pytest.mark.parametrize(
    ("prop", "event", "mend"),
    [
        ("pattern: '{mode: AUTO} every 1s'", '{mode: "AUTO"}', '/mode {mode: "AUTO"}'),
        ("pattern: '{limit > 3} at least 2 Hz over 2s'", "{limit > 3}", "/limit {limit > 3}"),
        (
            "pattern: 'while {mode: AUTO}: (not {limit > 3} and {mode: *}) every 1s'",
            "not {limit > 3} and {mode: *}",
            "/mode {…}",
        ),
        ("formula: 'not {often_auto < 1}', time: seconds", '{mode: "AUTO"}', '{topic: "/mode"} and {mode: "AUTO"}'),
        ("formula: '{many_auto >= 2}', time: seconds", '{mode: "AUTO"}', '{topic: "/mode"} and {mode: "AUTO"}'),
    ],
)
def test_what_is_held_comes_with_each_message_and_tells_no_silence(prop: str, event: str, mend: str) -> None:
    auto = "".join(f"  {name}_auto: {{{{{op}: '{{{{mode: AUTO}}}}', over: 2s}}}}\n" for name, op in AUTO.items())
    text = SPEC.replace("derive:\n", f"derive:\n{auto}").format(prop=prop)
    (found,) = (w.message for w in parse_spec(text, "s.yaml").warnings if "silence is not told" in w.message)
    assert f"silence is not told while other streams speak: `{event}` comes again at each of their messages" in found
    assert found.endswith(f"write it with its stream, as in `{mend}`")


@pytest.mark.parametrize(
    ("prop", "mend"),
    [
        ("pattern: 'at most 3 {mode: AUTO} within 1s'", '/mode {mode: "AUTO"}'),
        ("pattern: '{mode: AUTO} at most 2 Hz over 2s'", '/mode {mode: "AUTO"}'),
        ("pattern: 'at most 3 /mode {mode: AUTO} within 1s'", None),
        ("formula: 'not {often_auto > 1}'", '{topic: "/mode"} and {mode: "AUTO"}'),
        ("formula: 'not {many_auto > 2}'", '{topic: "/mode"} and {mode: "AUTO"}'),
        ("formula: 'not {last_auto > 2}'", None),  # of the last steps, of any stream
    ],
)
def test_what_is_held_is_counted_with_each_message(prop: str, mend: str | None) -> None:
    auto = "".join(f"  {name}_auto: {{{{{op}: '{{{{mode: AUTO}}}}', over: 2s}}}}\n" for name, op in AUTO.items())
    auto += "  last_auto: {{count: '{{mode: AUTO}}', over: 20}}\n"
    text = SPEC.replace("derive:\n", f"derive:\n{auto}").format(prop=prop)
    found = [w.message for w in parse_spec(text, "s.yaml").warnings if "it counts other streams" in w.message]
    assert len(found) == (mend is not None)
    assert all('`{mode: "AUTO"}` comes again at each of their messages' in each for each in found)
    assert all(each.endswith(f"write it with its stream, as in `{mend}`") for each in found)


@pytest.mark.parametrize("time", ["", ", time: seconds"])
@pytest.mark.parametrize(
    ("prop", "what"),
    [
        ("formula: 'not {per_minute < 300}'", "per_minute"),
        ("formula: '{mode: AUTO} -> not {few}'", "few"),
        ("pattern: 'always not {few}'", "few"),
        ("formula: '{per_minute != 0}'", "per_minute"),
        ("formula: '{few} -> {mode: STOP}'", "few"),
        ("formula: 'not {period > 0.2}'", "period"),  # which fails once there is none
        ("formula: '{period_ms <= 200}'", "period_ms"),
        ("formula: '{period < 2}'", "period"),  # the last one in 2 s is half a one each second
    ],
)
def test_what_is_computed_of_a_rate_has_no_deadline(prop: str, what: str, time: str) -> None:
    (found,) = told(prop + time)
    assert f"`{what}` is computed of `often`, which changes while no message comes" in found
    assert found.endswith("an expression has no deadlines; compare `often` itself, with `time: seconds`")


@pytest.mark.parametrize("time", ["", ", time: seconds"])
@pytest.mark.parametrize(
    "prop",
    [
        "pattern: 'no {idle > 1}'",
        "pattern: 'while {mode: AUTO}: no {idle > 1}'",
        "pattern: 'after /odom until /mode: no ({idle > 1} or {often < 3})'",
        "pattern: 'forall[m]. {mode: *m} requires {idle < 1}'",
    ],
)
def test_a_pattern_that_is_about_messages_is_told_to_be_written_with_always(prop: str, time: str) -> None:
    (found,) = told(prop + time)
    mend = "write what must hold with `always`, as `always not {…}`, and `time: seconds`"
    assert found.endswith(f"while no message comes, and such a pattern is about messages; {mend}")


@pytest.mark.parametrize(
    ("prop", "what", "mend"),
    [
        (
            "formula: '{topic: /odom} -> always[:10s] {idle <= 1}', time: seconds",
            "idle",
            'once[:10s] {topic: "/odom"} -> {idle <= 1}',
        ),
        ("formula: '{topic: /odom} -> always not {often < 5}'", "often", 'once {topic: "/odom"} -> not {often < 5}'),
        (
            "formula: '{topic: /odom} -> always[1s:2s] not {few}', time: seconds",
            "few",
            'once[1s:2s] {topic: "/odom"} -> not {few}',
        ),
        ("formula: 'always[:10] {idle <= 1}'", "idle", "{idle <= 1}"),
        ("formula: '{topic: /odom} -> always[:10] {idle <= 1}'", "idle", "once[:10s] {start} -> {…}"),
        (
            "formula: '{topic: /odom} -> {idle <= 1} until[:9s] {topic: /mode}', time: seconds",
            "idle",
            "once[:10s] {start} -> {…}",
        ),
        (
            "formula: 'forall[m]. {mode: *m} -> eventually[:1s] always[:9s] {idle <= 1}', time: seconds",
            "idle",
            "once[:10s] {start} -> {…}",
        ),
    ],
)
def test_what_waits_for_what_comes_is_judged_at_messages_alone(prop: str, what: str, mend: str) -> None:
    (found,) = told(prop)
    assert f"`{what}` changes while no message comes, and what waits for what comes is judged at messages" in found
    assert found.endswith(f"ask it of the past, as in `{mend}`, with `time: seconds`")


@pytest.mark.parametrize(
    ("prop", "what"),
    [
        ("formula: '{idle > 5} -> eventually[:3s] {topic: /odom}', time: seconds", "idle"),
        ("formula: '{mode: AUTO} and not {often >= 5} -> eventually[:3] {topic: /odom}'", "often"),
        ("formula: '{few} -> eventually[:3s] {topic: /odom}', time: seconds", "few"),
        ("formula: '{idle > 5} -> next {topic: /odom}'", "idle"),
        ("pattern: '{idle > 5} causes /odom within 3s'", "idle"),
        ("pattern: 'after {idle > 5}: some /odom within 3s'", "idle"),
        ("requirement: 'upon {often < 5} the robot shall within 3 seconds satisfy {topic: /odom}'", "often"),
    ],
)
def test_a_trigger_that_silence_makes_true_asks_at_messages_alone(prop: str, what: str) -> None:
    (found,) = told(prop)
    assert f"`{what}` changes while no message comes, and what waits for what comes is asked for at messages" in found
    assert found.endswith(
        "name the stream at whose messages it is meant, as in `{topic: /odom} and {idle > 5} -> …`, or ask it of the "
        "past, as in `{idle > 8} -> once[:3s] {stop}`, with `time: seconds`"
    )


@pytest.mark.parametrize("time", ["", ", time: seconds"])
@pytest.mark.parametrize(
    "prop",
    [
        "requirement: 'upon {mode: AUTO} the robot shall until {mode: IDLE} satisfy {idle <= 1}'",
        "requirement: 'upon {mode: AUTO} the robot shall for 10 s satisfy not {idle > 1}'",
    ],
)
def test_a_requirement_that_is_about_messages_is_told_to_be_written_otherwise(prop: str, time: str) -> None:
    (found,) = told(prop + time)
    mend = "write what must hold with `always` or `never`, or as a formula, and `time: seconds`"
    assert found.endswith(f"while no message comes, and such a requirement is about messages; {mend}")


@pytest.mark.parametrize(
    "prop",
    [
        "formula: '{topic: /odom} -> {idle <= 1}'",  # it is asked at /odom alone
        "pattern: 'no {topic: /odom, idle > 1}'",
        "pattern: '/odom requires {idle < 1} within 5s'",
        "pattern: 'no /odom'",
        "formula: '{idle <= 1}', guards: [/odom]",  # it is asked at what it guards
        "formula: 'not {idle < 0.1}'",  # silence does not break it
        "formula: 'not {often > 20}'",
        "formula: '{lately <= 2}'",
        "formula: 'not {last_ten < 3}'",  # time does not change it
        "formula: 'first -> eventually[:5] {idle < 1}'",
        "formula: '{topic: /odom} -> always[:5] {idle < 1}', time: steps",
        "formula: '{topic: /odom} -> always[:5] {idle < 1}', guards: [/odom]",
        "formula: '{topic: /odom} -> always[:5] ({topic: /odom} -> {idle < 1})'",
        "formula: '{topic: /odom} -> always[:5] not {idle < 0.1}'",
        "formula: '{topic: /odom} and {idle > 5} -> eventually[:3s] {topic: /scan}', time: seconds",
        "formula: '{idle < 5} -> eventually[:3s] {topic: /scan}', time: seconds",
        "formula: '{idle > 5} -> eventually[:3] {topic: /odom}', time: steps",
        "pattern: '/odom causes /scan within 3s'",
        "requirement: 'upon {mode: AUTO} the robot shall within 10 s satisfy {idle <= 1}'",
        "formula: 'not {per_minute > 3000}'",
        "formula: '{per_minute > 3000} -> {mode: FAST}', time: seconds",
        "pattern: 'always {few: *} and {part < 3}'",
        "formula: 'not {period < 0.01}'",
        "formula: '{period <= 2}'",
        "formula: '{gap <= 1}'",
        "formula: 'not {topic: /odom, idle > 1} and {mode: AUTO}'",  # silence has no /odom
        "formula: 'not {topic: /odom, per_minute < 300} and {mode: AUTO}', time: seconds",
        "formula: '{topic: /scan} -> {period <= 0.2}', time: seconds",
        "formula: 'not {share < 1}'",  # silence alone does not tell what it comes to
        "pattern: '/scan every 2s'",
        "pattern: '/mode {mode: AUTO} every 2s'",
        "pattern: '{mode: AUTO} at most 2 Hz over 2s'",
        "pattern: 'at most 3 {mode: AUTO} within 2s'",
        "pattern: '/scan at least 3 Hz over 2s'",
    ],
)
def test_nothing_is_said_of_what_is_meant_of_messages(prop: str) -> None:
    assert told(prop) == []


@pytest.mark.parametrize(
    ("prop", "violated"),
    [
        ("formula: '{idle <= 1}'", False),
        ("pattern: 'no {idle > 1}'", False),
        ("pattern: 'no {idle > 1}', time: seconds", False),
        ("formula: '{idle <= 1}', time: seconds", True),
        ("pattern: 'always not {idle > 1}', time: seconds", True),
        ("formula: '{topic: /scan} -> always[:80s] {idle <= 1}', time: seconds", False),
        ('formula: "once[:80s] {topic: /scan} -> {idle <= 1}", time: seconds', True),
        ("requirement: 'upon {topic: /scan} the robot shall for 80 s satisfy {idle <= 1}'", False),
        ("formula: '{idle > 5} -> eventually[:3s] {topic: /odom}', time: seconds", False),
        ("formula: '{idle > 8} -> once[:3s] {topic: /odom}', time: seconds", True),
    ],
)
def test_what_is_said_is_so(prop: str, *, violated: bool) -> None:
    ready = plan(parse_spec(SPEC.format(prop=prop), "s.yaml").spec)
    session = Session(ready, make_engines(ready), begun=SECOND)
    session.attach("m", ready.spec.by_key, SECOND)
    judged = session.ingest(Event(StreamKey("/scan", "topic"), "m", 1, SECOND, SECOND, {}))
    for at in range(2, 90):
        judged += session.advance(at * SECOND)
    judged += session.ingest(Event(StreamKey("/scan", "topic"), "m", 2, 90 * SECOND, 90 * SECOND, {}))
    judged += session.advance(95 * SECOND)
    outcomes = [row.verdicts[1].outcome.value for row in judged]
    assert ("currently_false" in outcomes) is violated
