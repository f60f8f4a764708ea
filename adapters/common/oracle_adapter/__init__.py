"""The link from a ROS adapter to an oracle server; it does not depend on ROS."""

from oracle_adapter.attention import Attention
from oracle_adapter.board import Board, graph_name
from oracle_adapter.connection import Timing
from oracle_adapter.decision import Answer, Policy, Why, should_pass
from oracle_adapter.errors import LinkError
from oracle_adapter.exchange import Stamp, State
from oracle_adapter.jsonvalues import dumps
from oracle_adapter.link import Link
from oracle_adapter.logfile import LogFile, open_log
from oracle_adapter.marks import ClockStamp
from oracle_adapter.names import PROXY, Names
from oracle_adapter.notices import Attached
from oracle_adapter.protocol import TimeSource
from oracle_adapter.screen import Status
from oracle_adapter.stats import Stats

__all__ = [
    "PROXY",
    "Answer",
    "Attached",
    "Attention",
    "Board",
    "ClockStamp",
    "Link",
    "LinkError",
    "LogFile",
    "Names",
    "Policy",
    "Stamp",
    "State",
    "Stats",
    "Status",
    "TimeSource",
    "Timing",
    "Why",
    "dumps",
    "graph_name",
    "open_log",
    "should_pass",
]
