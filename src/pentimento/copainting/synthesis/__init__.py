"""Pairs of partial and full paintings, planned with the robot's own stroke model (thesis 6.4.1)."""
