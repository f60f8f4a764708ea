"""ROS types: their definitions, and the shapes of their messages."""
