"""A supervised subcommand: ``python -m wackel_cli.child SUPERVISOR_PID COMMAND ...``.

It ends when its supervisor does, even by ``kill -9``: no orphan keeps a serial port. Where a
robot's control must outlive everything else, systemd supervises each service by itself instead
(``compose/systemd``).
"""

import ctypes
import os
import signal
import sys

from wackel_cli.__main__ import main
from wackel_node.errors import FAILED

_PR_SET_PDEATHSIG = 1  # prctl(2)


def follow(supervisor: int) -> bool:
    """Asks the kernel for SIGTERM when the parent dies; false if that has happened already."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    return os.getppid() == supervisor


if __name__ == "__main__":
    sys.exit(main(sys.argv[2:]) if follow(int(sys.argv[1])) else FAILED)
