"""What is computed for clients in processes of its own: a spec that is checked, a recording that is judged."""
