"""Observes, filters and proxies ROS 2 topics and services as an oracle server decides."""
