"""Differentiable models of how pushes deform a soft material, and the causes that extend them (thesis 7)."""
