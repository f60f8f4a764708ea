"""Being a process: settings, logs, the daemon, the clock."""
