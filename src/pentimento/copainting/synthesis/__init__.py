"""Partial and full paintings by the robot's own simulation (thesis 6.4.1)."""
