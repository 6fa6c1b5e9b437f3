"""The diagnosis on pushes: which causes explain what an analytic model gets wrong about a soft material."""
