"""The server's edge: which requests are let in, what they may do, and how long they may take."""
