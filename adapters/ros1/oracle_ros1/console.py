"""The log where rospy has set none up: it warns of that once, and what is logged is seen nowhere."""

from __future__ import annotations

import logging

from rosgraph.roslogging import RosStreamHandler


def log_anyway() -> None:
    """Have the log on the console, as elsewhere, where its folder can't be made or its configuration is not there.

    A configuration of somebody's own without the console is left alone.
    """
    logger = logging.getLogger("rosout")
    if not logging.getLogger().handlers and not any(isinstance(one, RosStreamHandler) for one in logger.handlers):
        logger.setLevel(logging.INFO)
        logger.addHandler(RosStreamHandler())
