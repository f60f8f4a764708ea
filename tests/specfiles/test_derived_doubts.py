"""What `check` warns of in derived signals: what their formulas never meet, and where they are absent."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec

TYPES = Types([], {})
STREAMS = """\
id: t
streams:
  - {topic: /on, type: std_msgs/msg/Bool, signals: {on: msg.data}}
  - {topic: /n, type: std_msgs/msg/UInt8, signals: {n: msg.data}}
  - {topic: /mode, type: std_msgs/msg/String, signals: {mode: msg.data}, hold: [mode]}
  - {topic: /pay, signals: {user: msg.user, amount: msg.amount}}
  - {topic: /cmd, signals: {speed: msg.speed}}
"""
SOUND = "properties: [{id: ok, formula: '{topic: /n} -> once {topic: /on}'}]\n"


def told(text: str) -> list[str]:
    """The warnings, without the file's name."""
    found = [str(each).split("warning: ", 1)[1] for each in parse_spec(STREAMS + text, "s.yaml", types=TYPES).warnings]
    elsewhere = ("no formula uses it", "is taken to last")  # which tests of their own are about
    return [each for each in found if not any(words in each for words in elsewhere)]


def derived(of: str, events: str = "up: '{on}', down: '{on: false}'") -> list[str]:
    return told(f"define: {{{events}}}\nderive: {{m: {of}}}\n{SOUND}")


MACHINE = "{start: a, states: {a: {up: b}, b: {down: a}}}"


@pytest.mark.parametrize(
    ("of", "events", "says"),
    [
        (MACHINE, "up: '{on: \"yes\"}', down: '{on}'",
         "`on: \"yes\"` is never met: `on` of /on is always true or false"),
        ("{sequence: up down*}", "up: '{n: 300}', down: '{on}'", "`n: 300` is never met"),
        ("{count: '{n > 300}', over: 1s}", "up: '{on}'", "`n > 300` is never met"),
        ("{age: '{topic: /on} and {n > 3}'}", "up: '{on}'", "`{topic: \"/on\"} and {n > 3}` never holds, whatever the "
         "messages say: only /n has `n`; name it under `hold` of /n, so that it keeps its value"),
        ("{rate: '{n >= 0}', over: 1s}", "up: '{on}'", "`n >= 0` is met by every value"),
        ("{follows: on, states: {'true': ['maybe'], 'maybe': ['true']}}", "up: '{on}'",
         "no value of `on` is the state 'maybe': it is always true or false"),
        ("{follows: n, states: {'1': ['2'], '2': ['300'], '300': ['1']}}", "up: '{on}'",
         "no value of `n` is the state '300': it is always a whole number from 0 to 255"),
        (MACHINE, "up: '{mode: AUTO}', down: '{on}'",
         '`{mode: "AUTO"}` comes again at each message while it holds, since `mode` keeps its value; write it with '
         "/mode, as in `{topic: …} and …`, if it is to come once"),
        ("{sum: n, over: 1s, by: user}", "up: '{on}'", "none of its samples counts: none has `user`; only /pay has "
         "`user`; name it under `hold` of /pay, so that it keeps its value"),
        ("{count: '{topic: /n}', over: 1s, by: user}", "up: '{on}'", "none of its samples counts: none has `user`"),
        ("{follows: mode, by: user, forget: 1h, states: {A: [B], B: [A]}}", "up: '{on}'",
         "no event of it counts: none has `user`"),
        ("{sequence: up down, by: [user, mode], forget: 1h}", "up: '{n: 1, mode: A}', down: '{on, mode: B}'",
         "no event of it makes a machine: none has all of `user` and `mode`; only /pay has `user`"),
        ("{follows: n, states: {'1.0': ['2'], '2': ['1.0']}}", "up: '{on}'", "no value of `n` is the state '1.0'"),
        ("{mean: n, over: 1}", "up: '{on}'", "the last sample alone is `n` itself; write `over: 1s`"),
        ("n - amount", "up: '{on}'", "it is never there: only /n has `n`; name it under `hold` of /n"),
        ("{start: a, states: {a: {up: b}, b: {}, error: {up: a, within: 3s}}}", "up: '{on}'",
         "`within` of 'error' is never told of: `machine: m` is violated as long as the machine is there"),
    ],
)  # fmt: skip
def test_what_hardly_was_meant_is_told(of: str, events: str, says: str) -> None:
    (found,) = derived(of, events)
    assert found.startswith(f"derived signal 'm': {says}")


def test_a_signal_that_is_read_twice_is_told_once() -> None:
    assert derived("(n - amount) * (n - amount)", "up: '{on}'") == derived("n - amount", "up: '{on}'")


@pytest.mark.parametrize(
    "of",
    [
        MACHINE,
        "{count: '{n > 3} or {on}', over: 1s}",
        "{count: '{mode: AUTO}', over: 1s}",
        "{age: '{topic: /mode, mode: AUTO}'}",
        "{follows: on, states: {'true': ['false'], 'false': ['true']}}",
        "{follows: mode, states: {A: [B], B: [A]}}",
        "{follows: n, states: {'1': ['2'], '2': ['1']}}",
        "{sequence: 'up (down | up)*'}",
        "{count: '{topic: /on} or not {topic: /on}', over: 1s}",
        "{sum: amount, over: 1s, by: user}",
        "{sum: n, over: 1s, by: mode}",
    ],
)
def test_nothing_is_said_of_what_is_right(of: str) -> None:
    assert derived(of) == []


def test_a_pattern_is_told_of_at_its_place() -> None:
    text = STREAMS + "properties:\n  - {id: p, pattern: '/n {n > 256} every 2s'}\n"
    (found,) = parse_spec(text, "s.yaml", types=TYPES).warnings
    assert (found.line, found.column) == (9, 23)
    assert "`n > 256` is never met" in found.message


@pytest.mark.parametrize(
    ("of", "prop", "says"),
    [
        ("{start: a, otherwise: stay, states: {a: {up: b}, b: {down: a}}}", "machine: m", "machine of 'p': {}`error`"),
        ("{start: a, states: {a: {up: b, down: a}, b: {up: b, down: a}}}", "machine: m", "machine of 'p': {}`error`"),
        ("{sequence: '(up | down)*'}", "machine: m", "machine of 'p': {}`failed`"),
        ("{start: a, otherwise: stay, states: {a: {up: b}, b: {down: a}}}", "formula: 'not {m: error}'", "formula of"),
        ("{start: a, otherwise: stay, states: {a: {up: b, within: 3s}, b: {down: a}}}", "machine: m", None),
        ("{start: a, states: {a: {up: b}, b: {down: a}}}", "machine: m", None),
        ("{start: a, states: {a: {up: error, down: a}}}", "machine: m", None),
        ("{start: a, states: {a: {up: b, down: a}, b: {up: b, down: a}, c: {up: a}}}", "machine: m", "machine of"),
        ("{sequence: 'up* down*'}", "machine: m", None),
        ("{follows: n, states: {'1': ['2'], '2': ['1']}}", "machine: m", None),
    ],
)  # fmt: skip
def test_a_machine_that_is_never_in_an_error_is_told_of(of: str, prop: str, says: str | None) -> None:
    text = f"define: {{up: '{{on}}', down: '{{on: false}}'}}\nderive: {{m: {of}}}\nproperties: [{{id: p, {prop}}}]\n"
    found = [each for each in told(text) if "nothing that comes" in each]
    assert len(found) == (says is not None)
    assert all(each.startswith((says or "").format("nothing that comes leads 'm' to ")) for each in found)


KEYED = (
    "derive: {spent: {sum: amount, over: 1h, by: user}, twice: 2.0 * spent, gap: amount - user, d: {delta: speed}}\n"
)


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("{topic: /cmd} -> {spent <= 5}", "`{spent <= 5}` never holds at an event of /cmd: `spent` needs `user`, and "
         "only /pay has `user`; name it under `hold` of /pay, so that it keeps its value"),
        ("not {topic: /cmd, twice > 5}", "`twice` needs `user`, and only /pay has `user`"),
        ("{topic: /cmd} -> not {gap < 0}", "`gap` needs `amount` and `user`, and only /pay has `amount` and `user`"),
        ("{topic: /n} -> {d < 1}", "`d` needs `speed`, and only /cmd has `speed`"),
    ],
)  # fmt: skip
def test_a_derived_signal_is_asked_for_where_it_may_be(formula: str, says: str) -> None:
    (found,) = told(f"{KEYED}properties: [{{id: p, formula: '{formula}'}}]\n")
    assert says in found


def test_a_guard_that_asks_for_what_its_stream_lacks_denies_none() -> None:
    filtered = STREAMS.replace("msg.speed}", "msg.speed}, action: filter")
    text = f"{filtered}{KEYED}properties: [{{id: p, formula: 'not {{spent > 5}}', guards: [/cmd]}}]\n"
    (found,) = (each.message for each in parse_spec(text, "s.yaml").warnings)
    assert found.startswith("property 'p': it guards /cmd, and holds at every event of it, whatever the messages say")


def test_with_its_key_held_it_is_there_everywhere() -> None:
    filtered = STREAMS.replace("msg.speed}", "msg.speed}, action: filter")
    held = filtered.replace("amount: msg.amount}", "amount: msg.amount}, hold: [user]")
    text = f"{held}{KEYED}properties: [{{id: p, formula: '{{topic: /cmd}} -> not {{spent > 5}}', guards: [/cmd]}}]\n"
    assert parse_spec(text, "s.yaml").warnings == ()


@pytest.mark.parametrize(
    ("prop", "says"),
    [
        ("pattern: 'while {on}: /n every 2s'", "`on` is not there while no message comes; name it under `hold` of its "
         "stream, so that it keeps its value"),
        ("pattern: 'while {on}: always {a <= 2}', time: seconds", "`on` is not there while no message comes"),
        ("time: seconds, formula: '{on} -> {a <= 2}'", "`on` is not there while no message comes"),
        ("pattern: 'while {topic: /on}: /n every 2s'", "its scope is one message, and over at once; write what opens "
         "and closes it, as in `after E until E`"),
    ],
)  # fmt: skip
def test_silence_that_no_deadline_tells_is_told_of(prop: str, says: str) -> None:
    (found,) = told(f"derive: {{a: {{age: '{{topic: /n}}'}}}}\nproperties: [{{id: p, {prop}}}]\n")
    assert found.endswith(" of 'p': no deadline violates it, so that silence is not told: " + says) or says in found


@pytest.mark.parametrize(
    "prop",
    [
        "pattern: 'while {mode: AUTO}: /n every 2s'",
        "pattern: 'after /on {on: false} until /on {on}: /n every 2s'",
        "pattern: 'while {on}: at most 3 /n within 1s'",
        "time: seconds, formula: '{topic: /cmd} -> {a <= 2}'",
        "time: seconds, formula: '{mode: AUTO} -> {a <= 2}'",
        "pattern: 'while {spent <= 1}: {amount: 100} at least 2 Hz over 1s'",
    ],
)
def test_nothing_is_said_of_silence_that_a_deadline_tells(prop: str) -> None:
    derive = "{a: {age: '{topic: /n}'}, spent: {sum: amount, over: 1s, by: user}}"
    assert told(f"derive: {derive}\nproperties: [{{id: p, {prop}}}]\n") == []


def test_an_event_that_comes_again_moves_nothing_where_its_state_keeps_it() -> None:
    rows = "{start: a, states: {a: {up: b, down: a}, b: {up: b, down: a}}}"
    assert derived(rows, "up: '{mode: AUTO}', down: '{mode: IDLE}'") == []
    assert derived(MACHINE, "up: '{on} and {mode: AUTO}', down: '{topic: /mode, mode: IDLE}'") == []


def test_a_heartbeat_of_one_topic_is_nothing_to_warn_of() -> None:
    text = (
        "id: t\nstreams: [{topic: /hb}]\nproperties: [{id: p, pattern: '/hb every 2s'}, "
        "{id: q, pattern: '/hb at least 2 Hz over 1s'}, {id: r, pattern: 'at most 5 /hb within 1s'}]\n"
    )
    assert parse_spec(text, "s.yaml").warnings == ()


@pytest.mark.parametrize(
    ("of", "says"),
    [
        ("{delta: mode}", "it always fails: `delta` takes numbers, and `mode` is always a text"),
        ("{mean: on, over: 3s}", "it always fails: `mean` takes numbers, and `on` is always true or false"),
        ("{sum: mode, over: 10, by: user}", "it always fails: `sum` takes numbers, and `mode` is always a text"),
        ("n - mode", "`mode` is text, and `-` takes numbers; write `double(mode)` where the text is a number"),
        ("mode > 3", "`mode` is text and `3`, and `>` takes two numbers or two texts"),
        ("n * on", "`on` is Boolean, and `*` takes numbers; write `(on ? 1 : 0)`"),
        ("{delta: n}", ""),
        ("{last: mode}", ""),
        ("{max: amount, over: 3s}", ""),
        ("{sum: speed, over: 3s, by: mode}", ""),
        ("'on ? n % 2 : n / 2.0'", ""),
        ("speed - mode", ""),  # nothing is known of one of them
        ("'mode == \"AUTO\" && on'", ""),
    ],
)
def test_what_is_computed_of_what_is_no_number_fails(of: str, says: str) -> None:
    found = [each for each in derived(of) if "fails" in each or "takes" in each]
    assert found == ([each for each in found if says in each] if says else [])
    assert bool(found) is bool(says)


@pytest.mark.parametrize(
    ("of", "formula", "says"),
    [
        (
            "{count: '{topic: /n}', over: 20}",
            "not {m > 30}",
            "`m` of /on, /n, /mode and 2 more is always a whole number from 0 to 20",
        ),
        ("{max: n, over: 1s}", "not {m > 300}", "is always a whole number from 0 to 255"),
        ("{last: n}", "not {m > 300}", "is always a whole number from 0 to 255"),
        ("n", "not {m > 300}", "is always a whole number from 0 to 255"),
    ],
)
def test_the_values_of_derived_signals_are_known(of: str, formula: str, says: str) -> None:
    (found,) = told(f"derive: {{m: {of}}}\nproperties: [{{id: p, formula: '{formula}'}}]\n")
    assert says in found


@pytest.mark.parametrize("limit", [5, 10])
def test_what_is_forgotten_is_never_known_to_be_so_old(limit: int) -> None:
    text = (
        f"{STREAMS}derive: {{a: {{age: '{{topic: /pay}}', by: user, forget: FORGET}}}}\n"
        f"properties: [{{id: p, time: seconds, formula: 'not {{a > {limit}}}'}}]\n"
    )
    (found,) = parse_spec(text.replace("FORGET", "5s"), "s.yaml").warnings
    assert found.message.endswith(f"write a `forget` of 'a' that is longer than the {limit} s")
    assert parse_spec(text.replace("FORGET", "11s"), "s.yaml").warnings == ()


def test_texts_are_no_numbers_of_a_formula_over_numbers() -> None:
    found = told("properties: [{id: p, formula: '(mode > 2) or (n > 3)', engine: rtamt}]\n")
    assert (
        found[0] == "property 'p' is never judged: `mode` of /on, /n, /mode and 2 more is always a text, and no number"
    )


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("(speed > 2) or (n > 3)", "'p' is never judged: no step has all of `speed` and `n`; `hold` keeps the last "
         "value"),
        ("(speed > 2)", "'p' is unknown where a signal is missing: /on (speed), /n (speed), /mode (speed), "
         "/pay (speed); `hold` keeps the last value"),
        ("(amount > 2) or (user > 3)", "missing: /on (amount, user), /n (amount, user), /mode (amount, user), "
         "/cmd (amount, user); `hold` keeps"),
    ],
)  # fmt: skip
def test_a_formula_over_numbers_needs_all_of_them_at_one_step(formula: str, says: str) -> None:
    (found,) = told(f"properties: [{{id: p, formula: '{formula}', engine: rtamt}}]\n")
    assert says in found
    keep = STREAMS.replace("signals: {n:", "hold: [n], signals: {n:").replace("speed}}", "speed}, hold: [speed]}")
    keep = keep.replace("amount}}", "amount}, hold: [amount, user]}")
    held = parse_spec(f"{keep}properties: [{{id: p, formula: '{formula}', engine: rtamt}}]\n", "s.yaml", types=TYPES)
    assert not [each for each in held.warnings if "judged" in each.message or "missing" in each.message]


@pytest.mark.parametrize("forget", ["2s", "3s"])
def test_what_is_forgotten_has_not_left_its_state_in_time(forget: str) -> None:
    of = f"{{by: user, forget: {forget}, start: a, states: {{a: {{up: b}}, b: {{up: a, within: 3s}}}}}}"
    (found,) = derived(of, "up: '{amount: 1}'")
    assert found.endswith("write a `forget` that is longer than the `within` of 3s")
    assert derived(of.replace(f"forget: {forget}", "forget: 4s"), "up: '{amount: 1}'") == []


@pytest.mark.parametrize(
    ("prop", "says"),
    [
        ("pattern: '/n at most 0.1 Hz over 2s'", "one in 2s is 0.5 Hz already, so that 0.1 Hz asks only whether any "
         "came; take it over 10s, or more"),
        ("pattern: '/n at least 0.3 hertz over 2s'", "one in 2s is 0.5 Hz already, so that 0.3 Hz asks only whether "
         "any came; take it over 4s, or more"),
        ("pattern: '/n at most 3Hz over 200ms'", "one in 200ms is 5 Hz already, so that 3 Hz asks only whether any "
         "came; take it over 334ms, or more"),
        ("formula: 'not {often < 0.25}', time: seconds", "one in 2s is 0.5 Hz already, so that 0.25 Hz asks only "
         "whether any came; take it over 4s, or more"),
        ("pattern: '/n at most 0.5 Hz over 2s'", None),
        ("pattern: '/n at least 0.5 Hz over 2s'", None),
        ("pattern: '/n at most 0 Hz over 2s'", None),
        ("pattern: 'at most 0 /n within 2s'", None),
        ("formula: 'not {often < 0.5}', time: seconds", None),
        ("formula: 'not {lately > 0}', time: seconds", None),
    ],
)  # fmt: skip
def test_a_rate_by_which_less_than_one_comes_in_its_window(prop: str, says: str | None) -> None:
    derive = "derive: {often: {rate: '{topic: /n}', over: 2s}, lately: {count: '{topic: /n}', over: 2s}}\n"
    found = [each.split(": ", 1)[1] for each in told(f"{derive}properties: [{{id: p, {prop}}}]\n")]
    assert [each for each in found if "already" in each] == ([] if says is None else [says])


ROWS = "  - {topic: /tf, each: msg.transforms, signals: {child: item.child_frame_id, row: index}}\n"


@pytest.mark.parametrize(
    ("prop", "counts_rows"),
    [
        ("pattern: '/tf at least 50 Hz over 1s'", True),
        ("pattern: '/tf at most 50 Hz over 1s'", True),
        ("pattern: 'at most 3 (/tf or /n) within 1s'", True),
        ("formula: 'not {often < 50}', time: seconds", True),
        ("pattern: '/tf {row: 0} at least 50 Hz over 1s'", False),
        ("pattern: '/tf {child: base} at least 50 Hz over 1s'", False),
        ("pattern: 'at most 3 /tf {child: *} within 1s'", False),
        ("pattern: '/tf every 1s'", False),
        ("pattern: '/n at least 50 Hz over 1s'", False),
    ],
)
def test_rows_that_are_counted_for_messages_are_told_of(prop: str, *, counts_rows: bool) -> None:
    text = STREAMS + ROWS + ("derive: {often: {rate: '{topic: /tf}', over: 1s}}\n" if "often" in prop else "")
    found = parse_spec(f"{text}properties: [{{id: p, {prop}}}]\n", "s.yaml", types=TYPES).warnings
    says = "it counts the rows of /tf, and not its messages, each of which has as many as its list"
    assert [each for each in found if says in each.message] == ([*found] if counts_rows else [])
    assert len(found) == counts_rows


@pytest.mark.parametrize(
    ("of", "each", "by"),
    [
        ("{last: child}", "msg.transforms", "row"),
        ("{previous: row}", "msg.transforms", "child"),
        ("{delta: row}", "msg.transforms", "child"),
        ("{follows: child, states: {a: [b], b: [a]}}", "msg.transforms", "row"),
        ("{delta: row, by: child, forget: 1h}", "msg.transforms", None),
        ("{max: row, over: 1s}", "msg.transforms", None),
        ("{delta: row}", "\"msg.transforms.filter(t, t.child_frame_id == 'base')\"", None),
        ("{delta: speed}", "msg.transforms", None),
    ],
)
def test_samples_of_one_row_after_the_other_are_told_of(of: str, each: str, by: str | None) -> None:
    found = told(f"{ROWS.replace('msg.transforms', each)}derive: {{m: {of}}}\n{SOUND}")
    says = "derived signal 'm': its samples are the rows of /tf, one after the other, whichever these are"
    assert [each for each in found if says in each and f"as in `by: {by}, forget: 1h`" in each] == found
    assert len(found) == (by is not None)


@pytest.mark.parametrize(
    ("pattern", "mend"),
    [
        ("/pay {user: *u} every 5s", "{age: '{…}', forget: 1h, by: user}"),
        ("at most 3 /pay {user: *u} within 5s", "{count: '{…}', over: 5s, by: user}"),
        ("/pay {user: *u} at least 2 Hz over 5s", "{rate: '{…}', over: 5s, by: user}"),
        ("forall[u]. after /pay {user: *u}: /pay {user: *u} every 5s", "{age: '{…}', forget: 1h, by: user}"),
        ("forall[u]. after /pay {user: *u}: /n every 5s", None),
        ("/pay {user: *} every 5s", None),
    ],
)
def test_a_variable_in_what_is_measured_is_told_of(pattern: str, mend: str | None) -> None:
    found = [each for each in told(f"properties: [{{id: p, pattern: '{pattern}'}}]\n") if "for all values" in each]
    assert len(found) == (mend is not None)
    assert all(f"as in `often: {mend}`" in each for each in found)


def test_a_variable_that_only_what_is_measured_has_is_refused_with_the_mend() -> None:
    text = f"{STREAMS}properties: [{{id: p, pattern: 'forall[u]. /pay {{user: *u}} every 5s'}}]\n"
    with pytest.raises(SpecError, match="measured for all values of `u` together; to tell it of each, write it under"):
        parse_spec(text, "s.yaml", types=TYPES)
