"""The experiment of the ROSMonitoring 2.0 paper, repeated on ROS 2."""
