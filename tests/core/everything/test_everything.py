"""Random sessions with all that a spec can say together: each row is what a plain reading of all steps says.

    CASES=20000 pytest tests/core/everything

is the long run, and SEED begins elsewhere. A case is told by its number alone.
"""

from __future__ import annotations

import os
import random
from collections import Counter

from tests.core.everything.cases import case
from tests.core.everything.running import Run
from tests.engines.test_against_brute import SEED

CASES = int(os.environ.get("CASES", "250"))
FOUND = (144, 1368, 1467, 1552, 3000004313)
"""Cases that earlier versions got wrong: attempts beside which a property was false for good, or could not be judged;
derived signals that were told to be absent where none had looked; and, by the reading itself, deadlines before an event
that was skipped.
"""


def test_each_row_is_what_all_steps_say() -> None:
    seen = Counter[str]()
    for number in (*range(SEED, SEED + CASES), *FOUND):
        rng = random.Random(f"everything {number}")
        run = Run(case(rng), rng)
        try:
            run.go()
        except AssertionError as error:
            raise AssertionError(f"case {number}: {error}") from error
        seen += run.counts()
    print(dict(seen))
    told = ("parts", "windows", "failing", "events", "derived", "last", "owed in time", "owed in steps")
    happened = ("late", "tick", "turned", "undone", "end", "owed true", "owed false", "owed false by time", *told)
    assert min(seen[what] for what in happened) > 0, seen
