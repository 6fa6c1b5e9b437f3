"""A third simulator of clay: a Bingham flow under a blunt oblong tool, by other laws than the model and the studio."""
