"""Serial ports for virtual buses: pseudo-terminals, paced in real time by one thread.

Any software opens the path of a bus as its serial port. Bytes leave it when the wire would have
delivered them; the baud rate is the one that the client has set on the terminal.
"""

import ctypes
import hashlib
import os
import queue
import select
import socket
import struct
import threading
import time
import tty
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from fcntl import ioctl
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from wackel_node.config import ConfigError
from wackel_virtual.bus import VirtualBus

if TYPE_CHECKING:  # it needs numpy, which a robot without wheels need not load
    from wackel_virtual.body import InPlane
    from wackel_virtual.coupled_drive import CoupledDrive, Sample

T = TypeVar("T")

_TCGETS2 = 0x802C542A
"""Linux: termios2, which unlike termios holds any baud rate as a number."""
_TERMIOS2 = struct.Struct("4I B 19s 2I")
PAUSE_NS = 1_000_000
"""The drive moves only if nothing is due on the wire for so long; a step takes some tenths of it,
and more where a computer has to fetch everything it needs from memory."""
QUIET_NS = 1_500_000
"""And only if nothing has been on the wire for so long: a host sends its next request within some
tenths of a millisecond, or when its next cycle is due."""
AHEAD_NS = 10_000_000
"""How far the drive then moves ahead: at 100 cycles per second it need not move before the next
pause, so that no request meets one of its steps."""
_PR_SET_TIMERSLACK = 29
_READ_BYTES = 65536
_LOOK_S = 1.0
"""How often who waits for the thread looks whether it lives."""


@contextmanager
def claimed(paths: Iterable[Path]) -> Iterator[None]:
    """Holds paths against other virtual robots.

    Raises:
        ConfigError: One of them runs at a path, or something else than a terminal's link is there.
    """
    with ExitStack() as stack:
        for path in paths:
            _spare(path)
            # A name in Linux's abstract name space is free again when its process is gone. It has
            # 107 bytes, a path may have more.
            name = hashlib.sha256(bytes(path.absolute())).hexdigest()
            claim = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            try:
                claim.bind(f"\0wackel-virtual:{name}")
            except OSError as error:
                raise ConfigError(
                    f"{path}: another virtual robot runs there; stop it first"
                ) from error
        yield


def _spare(path: Path) -> None:
    if os.path.lexists(path) and not _is_ours(path):
        raise ConfigError(f"{path}: exists and is no virtual port; choose another path")


def _is_ours(path: Path) -> bool:
    return path.is_symlink() and path.readlink().parent == Path("/dev/pts")


class Terminal:
    """A pseudo-terminal behind a path that stays the same when it is unplugged and plugged again.

    Raises:
        ConfigError: The path cannot be made, or something else than a terminal's link is there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.master = -1
        self._slave = -1
        self.plug()

    @property
    def plugged(self) -> bool:
        """Whether the path leads anywhere."""
        return self.master >= 0

    def plug(self) -> None:
        """Make a new terminal at the path."""
        _spare(self.path)
        self.master, self._slave = os.openpty()
        # The slave stays open here, so that settings and data outlive a client that closes it.
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        # A client sees either the old link or the new one, never none.
        fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        try:
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(os.ttyname(self._slave))
            fresh.replace(self.path)
        except OSError as error:
            self._close()
            raise ConfigError(f"{self.path}: cannot be made: {error.strerror}") from error

    def unplug(self) -> None:
        """Take the terminal away: the path is gone, and a client that has it open gets an error."""
        if self.plugged:
            if _is_ours(self.path) and str(self.path.readlink()) == os.ttyname(self._slave):
                self.path.unlink()
            self._close()

    def baud_rate(self) -> int:
        """What the client has set, bit/s."""
        settings = ioctl(self._slave, _TCGETS2, bytes(_TERMIOS2.size))
        return int(_TERMIOS2.unpack(settings)[-1])

    def read(self) -> bytes:
        """What the client has written; may be empty."""
        try:
            return os.read(self.master, _READ_BYTES)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Give to the client; what does not fit its buffer is lost, as in a serial driver."""
        with suppress(BlockingIOError):
            os.write(self.master, data)

    def _close(self) -> None:
        os.close(self.master)
        os.close(self._slave)
        self.master = self._slave = -1


class Ports:
    """Runs buses on terminals in a thread of its own, from ``with`` on.

    Args:
        buses: Each with the path of its port, by name.
        taps: Paths of second adapters that only listen, by the name of their (tapped) bus.
        drive: What the buses' servos move.
        on_sample: Called, in the thread, with what its gyros measure, and when: ns of the monotonic
            clock.
        on_pose: Called, in the thread, with where it is, and when, likewise.

    Raises:
        ConfigError: A port cannot be made.
    """

    def __init__(
        self,
        buses: Mapping[str, tuple[VirtualBus, Path]],
        taps: Mapping[str, Path] | None = None,
        drive: "CoupledDrive | None" = None,
        on_sample: "Callable[[Sample, int], None] | None" = None,
        on_pose: "Callable[[InPlane, int], None] | None" = None,
    ) -> None:
        self._drive = drive
        self._on_sample = on_sample
        self._on_pose = on_pose
        self._busy_ns = 0  # when something was on a wire
        self._buses = {name: bus for name, (bus, _) in buses.items()}
        self._terminals: dict[str, Terminal] = {}
        self._taps: dict[str, Terminal] = {}
        try:
            for name, (_, path) in buses.items():
                self._terminals[name] = Terminal(path)
            for name, path in (taps or {}).items():
                self._taps[name] = Terminal(path)
        except ConfigError:
            self._close_all()
            raise
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._wake_out, self._wake_in = os.pipe()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="virtual-wire")

    def __enter__(self) -> "Ports":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._submit(None)
        self._thread.join()
        self._close_all()
        os.close(self._wake_out)
        os.close(self._wake_in)

    def call(self, function: Callable[[Mapping[str, VirtualBus]], T]) -> T:
        """``function(buses by name)``, run between two events of the wire; its errors come back.

        Raises:
            RuntimeError: The thread has died.
        """
        # No SimpleQueue: the time limit of its get can fail, as in wackel_node.wake.
        done: queue.Queue[tuple[T | None, Exception | None]] = queue.Queue()

        def run() -> None:
            try:
                done.put((function(self._buses), None))
            except Exception as error:  # whatever it is belongs to the caller
                done.put((None, error))

        self._submit(run)
        while True:
            try:
                result, error = done.get(timeout=_LOOK_S)
                break
            except queue.Empty:
                if not self._thread.is_alive():
                    raise RuntimeError(f"the wire has died: {self._failure!r}") from self._failure
        if error is not None:
            raise error
        return result  # type: ignore[return-value]

    def _submit(self, call: Callable[[], None] | None) -> None:
        self._calls.put(call)
        os.write(self._wake_in, b"\0")

    def _close_all(self) -> None:
        for terminal in (*self._terminals.values(), *self._taps.values()):
            terminal.unplug()

    def _run(self) -> None:
        try:
            self._pace()
        except Exception as error:
            self._failure = error
            raise

    def _pace(self) -> None:
        _be_punctual()
        origin_ns = time.monotonic_ns()
        lines = [(self._terminals[name], bus) for name, bus in self._buses.items()]
        taps = [(terminal, self._buses[name]) for name, terminal in self._taps.items()]
        while True:
            due_ns = self._due_ns(time.monotonic_ns() - origin_ns)
            wait_s = None
            if due_ns is not None:
                wait_s = max(0.0, (due_ns - (time.monotonic_ns() - origin_ns)) / 1e9)
            watched = [terminal.master for terminal, _ in (*lines, *taps) if terminal.plugged]
            readable, _, _ = select.select([self._wake_out, *watched], [], [], wait_s)
            now_ns = time.monotonic_ns() - origin_ns
            if self._wake_out in readable and not self._run_calls(now_ns):
                return
            for terminal, bus in lines:
                if terminal.master in readable:
                    data = terminal.read()
                    if data:
                        bus.transmit(now_ns, data, terminal.baud_rate())
                        self._busy_ns = now_ns
                chunks = bus.deliveries(now_ns)
                if chunks:
                    self._busy_ns = now_ns
                if chunks and terminal.plugged:
                    terminal.write(b"".join(data for _, data in chunks))
                if bus.plugged != terminal.plugged:
                    (terminal.plug if bus.plugged else terminal.unplug)()
            for terminal, bus in taps:
                if terminal.master in readable:
                    terminal.read()  # its transmitter is connected with nothing
                heard = bus.overheard(now_ns)
                if heard:
                    terminal.write(b"".join(data for _, data in heard))
            if self._drive is not None:
                self._move(self._drive, now_ns, origin_ns)

    def _due_ns(self, now_ns: int) -> int | None:
        """When there is something to do without the host; None: never."""
        wire_ns = self._wire_ns()
        if self._drive is None or (wire_ns is not None and wire_ns < now_ns + PAUSE_NS):
            return wire_ns
        move_ns = max(self._drive.move_ns() - AHEAD_NS, self._busy_ns + QUIET_NS)
        times = (wire_ns, move_ns, self._drive.sample_ns())
        return min(at for at in times if at is not None)

    def _wire_ns(self) -> int | None:
        """When something will happen on a wire; None: not before a host sends."""
        times = [at for bus in self._buses.values() if (at := bus.next_ns()) is not None]
        return min(times, default=None)

    def _move(self, drive: "CoupledDrive", now_ns: int, origin_ns: int) -> None:
        """Let the drive move in a pause of the wires, or if it has been left behind."""
        wire_ns = self._wire_ns()
        idle = wire_ns is None or wire_ns >= now_ns + PAUSE_NS
        if idle and now_ns >= self._busy_ns + QUIET_NS:
            drive.advance(now_ns + AHEAD_NS)
        else:
            drive.catch_up(now_ns)
        for sample in drive.samples(now_ns):
            if self._on_sample is not None:
                self._on_sample(sample, origin_ns + sample.at_ns)
        if self._on_pose is not None:
            self._on_pose(drive.drivetrain.body.pose, origin_ns + drive.now_ns)

    def _run_calls(self, now_ns: int) -> bool:
        """Run what was submitted; False at the end."""
        os.read(self._wake_out, _READ_BYTES)
        for bus in self._buses.values():
            bus.advance(now_ns)
        if self._drive is not None:
            self._drive.advance(now_ns)
        while not self._calls.empty():
            call = self._calls.get()
            if call is None:
                return False
            call()
        return True


def _be_punctual() -> None:
    """Have the kernel wake this thread when asked, not up to 50 µs later (its usual slack)."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0)
