"""Judging again with what came late: `ordering: {late: revise}`."""
