"""The gap finder: what a simulation gets wrong, and why."""
