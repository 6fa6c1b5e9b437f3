"""Twelve photographs that packages ship, half of them for choosing settings and half held back.

Eleven come with scikit-image, scikit-learn and matplotlib. ``quokka`` comes with imgaug, of which only the file is
needed: `pip install --no-deps imgaug==0.4.0`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ImageError
from pentimento.contracts.images import read_image
from pentimento.planning.strokes.target import Part, fit_to_canvas


@dataclass(frozen=True)
class Picture:
    """A photograph inside a package."""

    package: str
    file: str
    licence: str | None
    """None where the package does not state that of the photograph, which is then scored and not shown."""
    part: Part | None = None

    def target(self, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Linear light [H, W, 3] at ``shape``.

        Raises:
            ImageError: the package is not installed or lacks the file.
        """
        found = find_spec(self.package)
        if found is None or found.origin is None:
            raise ImageError(f"The photograph {self.file} comes with {self.package}, which is not installed.")
        photograph = read_image(Path(found.origin).parent / self.file)
        return fit_to_canvas(photograph if self.part is None else self.part.of(photograph), shape).astype(np.float32)


_NASA = "public domain (NASA)"
DEVELOPMENT = {
    "astronaut_face": Picture("skimage", "data/astronaut.png", _NASA, Part(0.12, 0.0, 0.78, 0.44)),
    "tabby": Picture("skimage", "data/chelsea.png", "CC0 (Stéfan van der Walt)"),
    "coffee": Picture("skimage", "data/coffee.png", "CC0 (Rachel Michetti)"),
    "rocket": Picture("skimage", "data/rocket.jpg", "CC0 (SpaceX)"),
    "motorcycle": Picture("skimage", "data/motorcycle_left.png", None),
    "galaxies": Picture("skimage", "data/hubble_deep_field.jpg", _NASA),
}
"""Settings are chosen on these."""
HELD_BACK = {
    "admiral": Picture("matplotlib", "mpl-data/sample_data/grace_hopper.jpg", "public domain (US Navy)"),
    "quokka": Picture("imgaug", "quokka.jpg", None),
    "temple": Picture("sklearn", "datasets/images/china.jpg", "CC BY 2.0 (danielbuechele)"),
    "flower": Picture("sklearn", "datasets/images/flower.jpg", "CC BY 2.0 (vultilion)"),
    "astronaut": Picture("skimage", "data/astronaut.png", _NASA, Part(0.0, 0.0, 1.0, 0.7)),
    "retina": Picture("skimage", "data/retina.jpg", "CC0"),
}
"""Scored once."""
ALL = DEVELOPMENT | HELD_BACK
