"""Many recordings judged by the same specs: a table with a row for each recording and property."""
