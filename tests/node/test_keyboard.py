"""Keys from a real terminal."""

import os
import pty
import sys

import pytest

from tests.conftest import wait_until
from tests.terminal import on_terminal
from wackel_node.keyboard import Keyboard

pytestmark = pytest.mark.process

_SHELL = """
import os, signal, subprocess, sys

def to_the_foreground():
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    os.tcsetpgrp(0, os.getpid())
    signal.signal(signal.SIGTTOU, signal.SIG_DFL)

first = to_the_foreground if sys.argv[1] == "foreground" else None
job = subprocess.Popen([sys.executable, "-c", *sys.argv[2:]], process_group=0, preexec_fn=first)
_, status = os.waitpid(job.pid, os.WUNTRACED)
sys.exit(os.WIFSTOPPED(status) or os.waitstatus_to_exitcode(status))
"""
_WAITS_FOR_Q = """
import sys
from wackel_node.keyboard import Keyboard
with Keyboard() as keyboard:
    print("waiting", file=sys.stderr)
    while "q" not in keyboard.typed():
        pass
"""
_LOOKS_ONCE = """
import sys
from wackel_node.keyboard import Keyboard
with Keyboard() as keyboard:
    print("waiting", file=sys.stderr)
    assert keyboard.typed() == ""
"""


@pytest.mark.parametrize(
    ("ground", "job"), [("foreground", _WAITS_FOR_Q), ("background", _LOOKS_ONCE)]
)
def test_keys_come_in_the_foreground_and_nobody_is_suspended(ground: str, job: str) -> None:
    shell, terminal = on_terminal(sys.executable, "-c", _SHELL, ground, job)
    try:
        said = b""
        while b"waiting" not in said:
            said += os.read(terminal, 1024)
        os.write(terminal, b"xq")
        assert shell.wait(20) == 0
    finally:
        os.close(terminal)
        shell.kill()
        shell.wait()


def test_a_key_typed_while_the_program_starts_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal, side = pty.openpty()
    with os.fdopen(side) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        os.write(terminal, b"q")
        with Keyboard() as keyboard:
            wait_until(lambda: keyboard.typed() == "q", 2.0)
    os.close(terminal)
