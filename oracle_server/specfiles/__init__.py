"""Reading specs from YAML files, and the library of a server's specs."""
