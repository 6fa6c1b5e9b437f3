"""The painting half of the studio: a sheet, a brush or pen, and a camera."""
