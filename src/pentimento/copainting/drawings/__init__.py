"""Scenes of things with names, each drawn by a pen and painted by illustrators: what the base of the goal planner
learns from."""
