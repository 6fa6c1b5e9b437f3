"""How a tool marks the canvas: models of single strokes, trained on strokes that the robot has made."""
