"""A mobile base with a docked arm, and its mission, as ROS 1 nodes."""
