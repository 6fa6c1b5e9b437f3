"""What pictures mean: a text-image encoder trained here or published, and what is asked of it."""
