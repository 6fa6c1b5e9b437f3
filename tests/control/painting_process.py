"""Test support: a painting in a process of its own, begun or taken up in a folder, that can be killed anywhere."""

import sys
from pathlib import Path

from pentimento.control.session import carry_on
from tests.bundle.line_brush import journaled_sheet
from tests.control.paintings import begun, sitting


def main(folder: Path) -> None:
    """Print the number of strokes made after every change of the state."""
    robot = journaled_sheet(folder)
    if not (folder / "state.npz").exists():
        begun(robot, folder)
    carry_on(sitting(robot, folder, tell=lambda state: print(state.made, flush=True)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
