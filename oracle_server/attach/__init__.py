"""One monitor's WebSocket."""
