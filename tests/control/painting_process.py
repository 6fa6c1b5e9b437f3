"""Test support: a painting in its own process, begun or resumed in a folder, that can be killed at any time."""

import sys
from pathlib import Path

from pentimento.control.session import resume
from tests.bundle.line_brush import journaled_sheet
from tests.control.paintings import begun, session_of


def main(folder: Path) -> None:
    """Print the number of executed strokes after every change of the state."""
    robot = journaled_sheet(folder)
    if not (folder / "state.npz").exists():
        begun(robot, folder)
    resume(session_of(robot, folder, on_state=lambda state: print(state.executed, flush=True)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
