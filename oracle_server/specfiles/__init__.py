"""Text to `Spec`, and what is on hand."""
