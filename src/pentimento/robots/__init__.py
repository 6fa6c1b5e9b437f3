"""The robot side: what a tool is said to be, how a tip moves, and the drivers that move it."""
