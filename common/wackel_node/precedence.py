"""Which processes come before others: those between the wire and health.

What waits for a processor there is seen on the bus as lateness, and in health as a fault told late.
None of them computes for long at a time, so those who control the robot hardly wait for it.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

DIAGNOSIS = 1
"""Of what turns the bus's bytes into health."""
BUS = 2
"""Of what the servos wait for: diagnosis can be late, the next instruction cannot."""

_NICE = -10  # where real-time priority is not allowed, but this is


def come_first(steps: int) -> None:
    """Takes real-time priority as far as the system allows; threads and children inherit it.

    Args:
        steps: Above the priority with which this process was started.
    """
    try:
        _rise(steps)
    except OSError:
        with suppress(OSError):
            os.nice(_NICE)


def may_come_first() -> bool:
    """Whether the system allows this user as much as is asked for."""
    with ThreadPoolExecutor(1) as thread:  # which alone has it, and ends
        return thread.submit(_rise, BUS).exception() is None


def _rise(steps: int) -> None:
    """Of the calling thread.

    Raises:
        OSError: Not allowed.
    """
    above = os.sched_getparam(0).sched_priority + steps
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(above))
