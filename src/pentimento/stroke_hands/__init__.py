"""Hands of people as models: TrajVAE, its training, samples and maps, and who drew a stroke."""
