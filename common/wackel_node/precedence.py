"""Which processes come before others.

A fault on its way to health otherwise waits behind all else that the computer does. What turns it
into health never computes for long, so those who control the robot hardly wait for that; where it
does, as when a stranger floods its topics, it gives way. A gateway in mode poll does not take
precedence by itself: woken at once it costs a fifth more, since it is kept on one processor, and
loses its caches to those it interrupts. Its systemd unit gives it precedence, where a steady bus is
worth that.
"""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from wackel_node.log import logger

DIAGNOSIS = 1
"""Of what turns the bus's traffic into health."""
CONTROL = 2
"""Of what passes on the user's control of the servos, and of virtual servos."""

MOST_SHARE = 0.5
"""Of a processor: who takes more of it gives way, until half of that is enough. Diagnosis takes a
tenth, on a small computer a third."""
LOOK_S = 1.0
"""How often :class:`GiveWay` looks."""

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


class GiveWay:
    """Gives real-time priority up, with all threads, as long as this process computes too much.

    To be called every :data:`LOOK_S`.
    """

    def __init__(self) -> None:
        self._given = os.sched_getscheduler(0), os.sched_getparam(0)
        self._comes_first = self._given[0] == os.SCHED_FIFO
        self._has_given_way = False
        self._cpu_s, self._looked_s = time.process_time(), time.monotonic()

    def __call__(self) -> None:
        """Looks at what was computed since the last time."""
        cpu_s, now_s = time.process_time(), time.monotonic()
        share = (cpu_s - self._cpu_s) / (now_s - self._looked_s)
        self._cpu_s, self._looked_s = cpu_s, now_s
        if not self._comes_first:
            return
        if not self._has_given_way and share > MOST_SHARE:
            logger.warning(
                "took %.0f %% of a processor; other programs now come first", 100 * share
            )
            _have_all(os.SCHED_OTHER, os.sched_param(0))
            self._has_given_way = True
        elif self._has_given_way and share < MOST_SHARE / 2:
            logger.info("comes before other programs again")
            _have_all(*self._given)
            self._has_given_way = False


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


def _have_all(policy: int, parameters: os.sched_param) -> None:
    for thread in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # it has ended
            os.sched_setscheduler(int(thread.name), policy, parameters)
