"""A third simulator of pushes, for the base of the diagnosis only: a viscoplastic flow, written after the base."""
