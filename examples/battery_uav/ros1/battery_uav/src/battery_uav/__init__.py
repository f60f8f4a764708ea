"""A battery that counts down, its supervisor and its LED panel, as ROS 1 nodes."""
