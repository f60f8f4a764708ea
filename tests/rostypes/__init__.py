"""ROS types."""
