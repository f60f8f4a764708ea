"""External oracles, which are asked over ROSMonitoring's WebSocket protocol."""
