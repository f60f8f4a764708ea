"""Importing ROSMonitoring's configurations and property modules as specs; none of their code is run."""
