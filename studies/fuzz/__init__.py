"""Poisoned inputs for everything that reads a file: each is refused with one of our sentences, or it is sound."""
