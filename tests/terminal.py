"""A process on a real terminal of its own, which can be typed on and closed."""

import os
import pty
import subprocess
import sys

_TAKE = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""


def on_terminal(*command: str) -> tuple[subprocess.Popen[bytes], int]:
    """Starts it with its stdin and stderr there.

    Returns:
        The process, and the other end of the terminal, for the caller to close.
    """
    terminal, side = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", _TAKE, *command], stdin=side, stderr=side, start_new_session=True
    )
    os.close(side)
    return process, terminal
