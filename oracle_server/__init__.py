"""An oracle that watches robots: temporal logic over ROS messages, services and actions."""

__version__ = "0.1.0"
