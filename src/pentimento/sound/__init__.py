"""Sound: recordings, and the wish that a person speaks. Needs the extra `voice` to recognise words."""
