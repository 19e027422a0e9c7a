"""What tests of several parts share: a rendezvous of their own, and waiting without sleeping."""

import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
import zenoh

from wackel_node.config import RobotConfig, ZenohConfig
from wackel_node.session import session

# In the background of a shell SIGINT is ignored, which the processes under test would inherit.
signal.signal(signal.SIGINT, signal.default_int_handler)


@dataclass(frozen=True)
class Rendezvous:
    """A router that listens, and the configuration whose endpoint it is."""

    session: zenoh.Session
    config: RobotConfig


def free_port() -> int:
    """A TCP port on loopback that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


@pytest.fixture
def hangup_counts() -> Iterator[None]:
    """What a test starts heeds SIGHUP, even where the tests themselves run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def robot_config(tmp_path: Path) -> RobotConfig:
    """A configuration that collides with no other test: own port, own state directory."""
    return RobotConfig(
        robot="testbot",
        zenoh=ZenohConfig(endpoint=f"tcp/127.0.0.1:{free_port()}"),
        state_directory=str(tmp_path / "state"),
    )


@pytest.fixture
def rendezvous(robot_config: RobotConfig) -> Iterator[Rendezvous]:
    """An open router at the endpoint of ``robot_config``."""
    with session(robot_config, "router") as router:
        yield Rendezvous(router, robot_config)


def wait_until(
    condition: Callable[[], bool],
    limit_s: float = 10.0,
    meanwhile: Callable[[], object] | None = None,
) -> None:
    """Waits for a condition; ``meanwhile`` (such as ``lambda: link.pump(0.05)``) turns the wheel.

    Raises:
        AssertionError: The condition did not come true within the limit.
    """
    limit = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > limit:
            raise AssertionError(f"not within {limit_s:g} s: {condition}")
        if meanwhile is None:
            time.sleep(0.01)
        else:
            meanwhile()


@contextmanager
def killed_after(process: subprocess.Popen[str], limit_s: float = 60.0) -> Iterator[None]:
    """Kills a process that takes longer: who reads what it prints is told of its end."""
    timer = threading.Timer(limit_s, process.kill)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
