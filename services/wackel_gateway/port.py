"""A serial port: opened raw, exclusive and with low latency, read in bursts, lost with a reason.

Works on USB adapters, UARTs and pseudo-terminals alike.
"""

import errno
import fcntl
import os
import select
import struct
import termios
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import serial

_READ_BYTES = 65536  # more than a tty's buffer, so that one read empties it
_TIOCGICOUNT = 0x545D  # asm-generic/ioctls.h
_ICOUNT = struct.Struct("11i36x")  # serial_icounter_struct, linux/serial.h
_OVERRUN, _BUFFER_OVERRUN = 7, 10  # its fields
_SENT_MS = 1000  # 960 bytes at the slowest rate that servos have, more than any instruction
_TAKES_NONE = "it takes no bytes any more"
_GONE = select.POLLHUP | select.POLLERR | select.POLLNVAL

REASONS = {
    errno.ENOENT: "there is no such port",
    errno.EACCES: "no permission to open it",
    errno.EBUSY: "another program has it open",
    errno.EAGAIN: "another program has it open",
    errno.EIO: "it was unplugged",
    errno.ENODEV: "it was unplugged",
    errno.ENXIO: "it was unplugged",
    errno.EBADF: "it was unplugged",
    errno.ENOTTY: "it is no serial port",
    errno.EISDIR: "it is no serial port",
}


class PortLost(ConnectionError):
    """The port cannot be opened, or is there no more; the text says why, as part of a sentence."""


class Port:
    """An open port.

    Attributes:
        path: As configured.
        heard: Whether any byte has come.
        latency_timer_ms: USB latency timer as the driver tells it; absent where it tells none.
    """

    def __init__(self, path: str, baud_rate: int) -> None:
        """Opens it. Raises :class:`PortLost` with the reason where that fails."""
        self.path = path
        self.heard = False
        try:
            self._serial = serial.Serial(path, baud_rate, timeout=0, exclusive=True)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise PortLost(_reason(error)) from error
        self.fd = self._serial.fileno()
        self._poll = select.poll()
        self._poll.register(self.fd, select.POLLIN)
        self.latency_timer_ms = self._lower_latency()
        self.discard()
        if not self._writable(0):
            self.close()
            raise PortLost(_TAKES_NONE)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Gives the port back."""
        self._serial.close()

    @property
    def baud_rate(self) -> int:
        """Bit/s."""
        return int(self._serial.baudrate)

    @baud_rate.setter
    def baud_rate(self, value: int) -> None:
        try:
            self._serial.flush()  # what was written goes out at the rate it was written for
            self._serial.baudrate = value
        except (OSError, ValueError) as error:
            raise PortLost(_reason(error)) from error

    def write(self, data: bytes) -> None:
        """Sends all of it. Raises :class:`PortLost`."""
        try:
            written = os.write(self.fd, data)
            while written < len(data):
                if not self._writable(_SENT_MS):
                    raise BlockingIOError
                written += os.write(self.fd, data[written:])
        except BlockingIOError as error:
            raise PortLost(_TAKES_NONE) from error
        except OSError as error:
            raise PortLost(_reason(error)) from error

    def read(self) -> bytes:
        """What has come, at once; empty if nothing. Raises :class:`PortLost`."""
        try:
            data = os.read(self.fd, _READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise PortLost(_reason(error)) from error
        self.heard = self.heard or bool(data)
        return data

    def wait(self, timeout_ms: float) -> bool:
        """Waits for bytes; whether there are any. Raises :class:`PortLost` on a hang-up."""
        events = self._poll.poll(timeout_ms)
        if not events:
            return False
        if events[0][1] & _GONE:
            raise PortLost(REASONS[errno.EIO])
        return True

    def discard(self) -> None:
        """Throws away what came while nobody listened."""
        try:
            self._serial.reset_input_buffer()
        except OSError as error:
            raise PortLost(_reason(error)) from error

    def overruns(self) -> int | None:
        """Overruns that the driver counted since boot; absent where it counts none."""
        buffer = bytearray(_ICOUNT.size)
        try:
            fcntl.ioctl(self.fd, _TIOCGICOUNT, buffer)
        except OSError:
            return None
        counts = _ICOUNT.unpack(buffer)
        return int(counts[_OVERRUN] + counts[_BUFFER_OVERRUN])

    def _writable(self, timeout_ms: float) -> bool:
        """Whether it takes bytes, or does so in time."""
        waiting = select.poll()
        waiting.register(self.fd, select.POLLOUT)
        return bool(waiting.poll(timeout_ms))

    def _lower_latency(self) -> int | None:
        with suppress(OSError, ValueError):  # not every driver knows it; what holds is read back
            self._serial.set_low_latency_mode(True)
        name = Path(self.path).resolve().name
        try:
            return int(Path(f"/sys/class/tty/{name}/device/latency_timer").read_text())
        except (OSError, ValueError):
            return None


def _reason(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number is None and isinstance(error.__context__, termios.error):
        number = error.__context__.args[0]  # pyserial hides it in its text
    return str(error) if number is None else REASONS.get(number, str(error))
