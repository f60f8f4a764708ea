"""Which violation begins an episode."""

from __future__ import annotations

from oracle_server.sessions.alarms import GAP, Episodes


def test_what_comes_close_together_is_one_episode_of_its_property() -> None:
    episodes = Episodes()
    stamps = (0, GAP - 1, 2 * GAP - 2, 3 * GAP - 2, 3 * GAP - 1)
    assert [episodes.begins("p", stamp) for stamp in stamps] == [True, False, False, True, False]
    assert episodes.begins("q", 1)
    assert not episodes.begins("p", 0), "one that was late"
    assert not episodes.begins("p", 4 * GAP - 2), "the gap is from the latest"
