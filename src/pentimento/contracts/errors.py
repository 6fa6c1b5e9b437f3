"""Named errors. Each message is a sentence: what was wrong, where, and what to do about it."""


class PentimentoError(Exception):
    """Root of all errors that the project raises on purpose."""


class ContractError(PentimentoError):
    """Data breaks its contract: a column, a shape, a window, a plan."""


class UnitError(PentimentoError):
    """A quantity could not be read, or its unit has another dimension than the one asked for."""


class EnvelopeViolation(PentimentoError):
    """A command lies outside the robot's safety envelope. Commands are rejected, never clamped."""


class ImageError(PentimentoError):
    """An image is missing, unreadable, or of another type or shape than needed."""


class ConfigError(PentimentoError):
    """A configuration, tool or world file has an unknown, missing or impossible entry."""


class CalibrationError(PentimentoError):
    """The camera could not be registered to the canvas."""
