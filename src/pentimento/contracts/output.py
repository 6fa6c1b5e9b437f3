"""What is printed: terminals and log files may have an encoding that lacks letters."""

import io
import sys


def escape_unknown_letters() -> None:
    """From now on, print a letter that the output's encoding lacks as its number, such as \\xd7, not as an error."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
