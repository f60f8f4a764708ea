"""The server as a process: its settings, logs, clock and pid file, and running it in the background."""
