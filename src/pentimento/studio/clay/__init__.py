"""The clay half of the studio: a slab that yields, remembers and slides, and a scanner above it."""
