"""Tables of strokes that come from elsewhere: bringing them into the contract, and saying what they can tell."""
