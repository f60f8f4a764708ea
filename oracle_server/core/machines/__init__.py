"""Machines: states, and the events that lead from one to another; signals are made of them."""
