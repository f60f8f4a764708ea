"""Packages that are well known and not among the bundled ones, so that none is taken for a misspelt other one."""

from __future__ import annotations

_NAMES = frozenset({
    "ackermann_msgs", "can_msgs", "control_msgs", "gps_msgs", "grid_map_msgs", "mavros_msgs", "moveit_msgs",
    "nav2_msgs", "octomap_msgs", "px4_msgs", "turtlebot3_msgs", "ublox_msgs", "vision_msgs",
})  # fmt: skip
_FAMILIES = ("autoware_", "rmf_", "tier4_")


def is_well_known(package: str) -> bool:
    """Whether a package is one that is meant as it is written: `nav2_msgs` is no `nav_msgs`."""
    return package in _NAMES or package.startswith(_FAMILIES)
