"""What is doubtful in a recording, or was not judged of it."""
