"""Acting beside a person: the safety envelope, looking at the canvas, painting, recording."""
