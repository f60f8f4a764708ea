"""An oracle that watches robots: past-time temporal logic over ROS messages and services."""

__version__ = "0.1.0"
