"""The published sizes of the goal planner and the encoders, with random weights: time and memory."""
