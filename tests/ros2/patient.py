"""An adapter in which nothing is given up that waits for what came before it, so that a slow machine changes nothing.

python -m tests.ros2.patient WORDS…
"""

from __future__ import annotations

import sys

import oracle_adapter.behind
import oracle_ros2.goals
import oracle_ros2.standing
from oracle_ros2.__main__ import main

oracle_adapter.behind.LONGEST = oracle_ros2.standing.LONGEST = oracle_ros2.goals.UNASKED = 3600.0
sys.exit(main())
