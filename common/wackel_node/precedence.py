"""Which processes come before others.

A fault on its way to health otherwise waits behind all else that the computer does. What turns it
into health never computes for long, so those who control the robot hardly wait for that. A gateway
in mode poll does not take precedence by itself: woken at once it costs a fifth more, since it is
kept on one processor, and loses its caches to those it interrupts. Its systemd unit gives it
precedence, where a steady bus is worth that.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

DIAGNOSIS = 1
"""Of what turns the bus's traffic into health."""
CONTROL = 2
"""Of what passes on the user's control of the servos."""

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
        return thread.submit(_rise, CONTROL).exception() is None


def _rise(steps: int) -> None:
    """Of the calling thread.

    Raises:
        OSError: Not allowed.
    """
    above = os.sched_getparam(0).sched_priority + steps
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(above))
