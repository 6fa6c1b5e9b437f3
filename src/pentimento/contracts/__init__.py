"""Contracts: tables, frames, units, colour and covariates - what a number or a column means.

Everything else imports this package; it imports nothing else of the project.
"""
