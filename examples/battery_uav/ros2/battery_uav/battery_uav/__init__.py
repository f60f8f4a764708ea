"""A UAV's battery, its supervisor and its LED panel, for ROS 2."""
