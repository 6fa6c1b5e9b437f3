"""The robot side: tools, rigs, tip motion, and drivers."""
