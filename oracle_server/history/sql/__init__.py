"""What histories in SQL databases have in common: tables, statements, the writer and the readers."""
