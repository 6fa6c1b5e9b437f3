"""The diagnosis: what a simulation gets wrong, and why."""
