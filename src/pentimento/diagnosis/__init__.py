"""What a simulation gets wrong, and why: statistics that strokes and pushes share."""
