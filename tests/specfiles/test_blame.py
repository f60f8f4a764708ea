"""What is said of guards that may deny what is not to blame, or let pass what is."""

from __future__ import annotations

import pytest

from oracle_server.specfiles.load import parse_spec


@pytest.mark.parametrize(("blame", "warnings"), [("", 1), ("blame: caused", 0), ("blame: any", 0)])
def test_a_denial_of_what_is_not_to_blame_is_warned_of_unless_it_is_meant(blame: str, warnings: int) -> None:
    text = (
        "id: x\nstreams:\n  - {topic: /a, action: filter, signals: {v: msg.v}}\n  - {topic: /b, signals: {w: msg.w}}\n"
        f"properties:\n  - {{id: p, formula: 'not once {{w: 1}}', guards: [/a]{', ' * bool(blame)}{blame}}}\n"
    )
    found = parse_spec(text, "x").warnings
    assert len(found) == warnings, found
    assert all("`blame: caused` denies only what withholding mends, and `blame: any` says" in f.message for f in found)


@pytest.mark.parametrize(
    ("on_deny", "blame", "told"),
    [
        ("keep", "", "`blame: caused` at the property and `on_deny: undo` at /a deny only what withholding mends"),
        (
            "keep",
            "blame: caused",
            "write `on_deny: undo` at /a, so that what is denied never happened, ",
        ),
        ("keep", "blame: any", ""),
        ("undo", "", "`blame: caused` denies only what withholding mends"),
        ("undo", "blame: caused", ""),
    ],
)
@pytest.mark.parametrize("says", ["formula: 'historically[:9] not {v: 1}'", "pattern: 'at most 2 /a within 1s'"])
def test_a_guard_that_looks_back_at_what_it_denies_is_told_of_undo(
    on_deny: str, blame: str, told: str, says: str
) -> None:
    found = parse_spec(
        f"id: x\nstreams:\n  - {{topic: /a, action: filter, on_deny: {on_deny}, signals: {{v: msg.v}}}}\n"
        f"properties:\n  - {{id: p, {says}, guards: [/a]{', ' * bool(blame)}{blame}}}\n",
        "x",
    ).warnings
    assert len(found) == bool(told), found
    assert all(told in f.message for f in found)


def test_a_guard_of_which_withholding_mends_all_may_be_to_blame_for_what_it_caused() -> None:
    for text in ("{v: 1} -> not pre once[:5] {v: 1}", "not {v: 1}"):
        assert not parse_spec(
            "id: x\nstreams: [{topic: /a, action: filter, signals: {v: msg.v}}]\n"
            f"properties: [{{id: p, formula: '{text}', guards: [/a], blame: caused, latch: true}}]\n",
            "x",
        ).warnings
