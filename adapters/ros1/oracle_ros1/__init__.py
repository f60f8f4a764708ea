"""Observes, filters and proxies ROS 1 topics and services as an oracle server decides."""
