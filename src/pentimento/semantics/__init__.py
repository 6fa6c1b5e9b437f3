"""Text-image encoders, their training and scores, and the semantic and style objectives of plans."""
