"""A spec from what ROSMonitoring was configured with, which is read and never run."""
