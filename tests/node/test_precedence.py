"""Real-time priority where the system allows it, and what there is instead."""

import os
import subprocess
import sys

import pytest

from wackel_node.precedence import CONTROL, DIAGNOSIS, may_come_first

# In a process of its own: nobody gives priority back.
_TELL = """
import os, sys, threading
from wackel_node.precedence import come_first
{before}
come_first(int(sys.argv[1]))
tell = lambda: print(os.sched_getscheduler(0) == os.SCHED_FIFO, os.sched_getparam(0).sched_priority)
thread = threading.Thread(target=tell)
thread.start()
thread.join()
"""
_GIVEN = "os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(5))"
_FORBIDDEN = """
def forbidden(*_):
    raise PermissionError
os.sched_setscheduler = forbidden
os.nice = lambda by: print("nice", by)
"""


def told(steps: int, before: str = "") -> str:
    """What a thread that was started later has."""
    command = [sys.executable, "-c", _TELL.format(before=before), str(steps)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.mark.skipif(not may_come_first(), reason="real-time priority is not allowed here")
@pytest.mark.process
def test_control_is_above_diagnosis_and_both_above_what_started_them() -> None:
    assert told(DIAGNOSIS) == "True 1\n"
    assert told(CONTROL) == "True 2\n"
    assert told(CONTROL, _GIVEN) == "True 7\n"


@pytest.mark.process
def test_where_it_is_forbidden_a_better_priority_is_asked_for() -> None:
    assert told(DIAGNOSIS, _FORBIDDEN) == "nice -10\nFalse 0\n"


_COMPUTE = """
import os, threading, time
from wackel_node.precedence import DIAGNOSIS, GiveWay, come_first
come_first(DIAGNOSIS)
give_way = GiveWay()
over = threading.Event()
def has_priority(thread):
    return os.sched_getscheduler(thread.native_id) == os.SCHED_FIFO
other = threading.Thread(target=over.wait)
other.start()
def compute(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
compute(0.1)
give_way()
print(has_priority(other), has_priority(threading.main_thread()))
over.wait(0.3)
give_way()
print(has_priority(other), has_priority(threading.main_thread()))
over.set()
"""


@pytest.mark.skipif(not may_come_first(), reason="real-time priority is not allowed here")
@pytest.mark.process
def test_who_computes_too_much_gives_way_until_it_does_so_no_more() -> None:
    command = [sys.executable, "-c", _COMPUTE]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "False False\nTrue True\n"


def test_asking_changes_nothing_here() -> None:
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    may_come_first()
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before
