"""Reading recordings, and judging them offline."""
