"""A mobile base with a docked arm, and its mission, for ROS 2."""
