"""What `check` refuses or warns of: specs that can be read, but would not work as they are meant."""
