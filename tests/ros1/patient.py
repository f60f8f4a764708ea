"""An adapter in which no result is given up that waits for feedback, so that a slow machine changes nothing.

python -m tests.ros1.patient WORDS…
"""

from __future__ import annotations

import sys

import oracle_adapter.behind
from oracle_ros1.__main__ import main

oracle_adapter.behind.LONGEST = 3600.0
sys.exit(main())
