"""The sculptor: pushes planned so that clay comes nearer to a goal, in 3D and in what the eye sees (thesis 7.3.5)."""
