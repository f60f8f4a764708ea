"""What a replay came to, in the formats that it is told in."""
