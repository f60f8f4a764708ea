"""The frames of the wire, and nothing that acts on them."""
