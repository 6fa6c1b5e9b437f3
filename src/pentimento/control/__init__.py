"""Execution together with a person: safety envelope, closed loop of observing and replanning, session, page."""
