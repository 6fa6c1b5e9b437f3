"""Executing beside a person: safety envelope, closed loop of observing and replanning, session, page."""
