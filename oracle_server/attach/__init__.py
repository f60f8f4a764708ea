"""The WebSockets of monitors: the project's own protocol, and ROSMonitoring's."""
