"""What Zenoh alone takes for the way of a fault: the peer of its latency.

A chain of processes like the robot's, gateway to classifier to aggregator and from there to a
program: the same sessions and as many hops, but each process only passes bytes on, in Zenoh's own
callback. What a latency is longer than this is wackel's.
"""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import zenoh
from zenoh.handlers import Callback

from tests.conftest import wait_until
from tests.robot import process
from wackel_node.config import RobotConfig, load
from wackel_node.precedence import DIAGNOSIS, come_first
from wackel_node.session import session

_RELAYS = 2  # classifier, aggregator
_BYTES = 900  # a transaction of 20 servos; a fault report is a third longer
_LIMIT_S = 5.0


class Chain:
    """Measures the way through all relays.

    Args:
        begin: Session of the process at which it begins.
        end: Session of the program in which it ends.
    """

    def __init__(self, begin: zenoh.Session, end: zenoh.Session) -> None:
        self._back = threading.Event()
        self._at_ns = 0
        self._subscriber = end.declare_subscriber(
            _key(_RELAYS), Callback(self._arrived, indirect=False)
        )
        self._publisher = begin.declare_publisher(
            _key(0), congestion_control=zenoh.CongestionControl.DROP
        )
        wait_until(self._passes, _LIMIT_S, lambda: None)

    def took_ms(self) -> float:
        """Once through."""
        begin_ns = time.monotonic_ns()
        if not self._passes():
            raise RuntimeError("a message got lost between bare Zenoh processes")
        return (self._at_ns - begin_ns) / 1e6

    def _passes(self) -> bool:
        self._back.clear()
        self._publisher.put(bytes(_BYTES))
        return self._back.wait(0.5)

    def _arrived(self, _: zenoh.Sample) -> None:
        self._at_ns = time.monotonic_ns()
        self._back.set()


@contextmanager
def relays(config: RobotConfig, path: Path, end: zenoh.Session) -> Iterator[Chain]:
    """Starts the processes.

    Args:
        config: Of a running robot, whose rendezvous is used.
        path: The file it is in; what the processes log goes beside it.
        end: Session of the program that reads.
    """
    with ExitStack() as stack:
        begin = session(config, "peer")
        stack.callback(begin.close)
        for number in range(_RELAYS):
            stack.enter_context(
                process("tests.bench.hops", str(path), str(number), log=path.with_suffix(".hops"))
            )
        yield Chain(begin, end)


def _key(number: int) -> str:
    return f"bench/hops/{number}"


def main(argv: list[str]) -> int:
    """A relay: passes on what arrives until it is killed."""
    number = int(argv[1])
    come_first(DIAGNOSIS)  # as those do whose way it is
    with session(load(Path(argv[0])), "peer") as relay:
        publisher = relay.declare_publisher(
            _key(number + 1), congestion_control=zenoh.CongestionControl.DROP
        )
        subscriber = relay.declare_subscriber(
            _key(number),
            Callback(lambda sample: publisher.put(sample.payload), indirect=False),
        )
        threading.Event().wait()
        subscriber.undeclare()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
