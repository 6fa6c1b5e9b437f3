"""Contracts: the meaning of numbers and columns (tables, frames, units, colour, covariates).

Everything else imports this package; it imports nothing else of the project.
"""
