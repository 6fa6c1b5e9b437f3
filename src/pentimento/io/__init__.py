"""Import of recorded strokes into the contract, export, and data cards of tables."""
