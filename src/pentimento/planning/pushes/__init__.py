"""Plans of pushes and pinches that sculpt clay towards a goal."""
