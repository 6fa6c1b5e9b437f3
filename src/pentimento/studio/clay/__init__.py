"""The clay half of the studio: a slab with a deformation history, and a scanner above it."""
