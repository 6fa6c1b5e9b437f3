"""Test support: an untrained handwriting style."""

from __future__ import annotations

import numpy as np

from pentimento.planning.strokes.latent import Layer, StyleDecoder

HAND_POINTS = 6


def small_hand(name: str, points: int = HAND_POINTS) -> StyleDecoder:
    """Nearly straight strokes of about 15 mm, whose two latents bend them and change their length."""
    along = np.linspace(-0.5, 0.5, points, dtype=np.float32)
    bend = np.stack([0 * along, 0.3 * (0.25 - along**2)], axis=-1).ravel()
    longer = np.stack([0.2 * along, 0 * along], axis=-1).ravel()
    line = np.stack([along, 0 * along], axis=-1).ravel()
    layers = (Layer(np.stack([bend, longer]), line),)
    means = np.random.default_rng(0).normal(size=(5, 2)).astype(np.float32)
    return StyleDecoder(name, layers, 0.015, means, np.full((5, 2), 0.1, np.float32))
