"""SVG drawings as lines: what a viewer shows, read without changing it."""
