"""Stroke models that are networks (thesis 4.3.2, 5.4.3), trained by one loop, beside Traj2Stroke."""
