"""What goal planners answer on begun canvases, in numbers, pictures and people's preferences (thesis 6.5–6.8)."""
