"""Objectives that need PyTorch: what a painting should be made of; and any such objective as the planner asks."""
