"""An IIO gyro: found in sysfs, set up for buffered reading, read through its node.

Source: Linux, Documentation/ABI/testing/sysfs-bus-iio and Documentation/iio/iio_devbuf.rst.
"""

import errno
import math
import os
import select
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from wackel_imu.core import AXES, TIMESTAMP, Decoder, Now, Scale
from wackel_imu.scan import BadLayout, Element, Layout, element
from wackel_node.config_drive import GyroConfig
from wackel_node.log import logger
from wackel_schemas.drive import ImuSample

BUFFERED_S = 1.0
"""How long a computer may be busy before the kernel drops samples."""
_READ_BYTES = 65536
_MOST = 1e9
"""No scale and no offset is larger; it also refuses what is no number."""

_CLOCKS = {
    "realtime": time.CLOCK_REALTIME,
    "monotonic": time.CLOCK_MONOTONIC,
    "monotonic_raw": time.CLOCK_MONOTONIC_RAW,
    "realtime_coarse": time.CLOCK_REALTIME,
    "monotonic_coarse": time.CLOCK_MONOTONIC,
    "boottime": time.CLOCK_BOOTTIME,
    "tai": time.CLOCK_TAI,
}
_BEST_CLOCK = "monotonic"  # nobody sets it


class DeviceLost(ConnectionError):
    """The device cannot be used, or is there no more; the text says why, as part of a sentence."""


class Device:
    """A gyro that delivers samples from ``with`` on.

    Args:
        config: Its section, of source iio.
        utc_ns: The clock for stamps.
        sysfs, nodes: Where /sys and /dev are looked for.

    Raises:
        DeviceLost: It is not there, is no gyro, or cannot be set up.
    """

    def __init__(
        self,
        config: GyroConfig,
        utc_ns: Callable[[], int],
        sysfs: Path = Path("/sys"),
        nodes: Path = Path("/dev"),
    ) -> None:
        self._utc_ns = utc_ns
        self._directory = find(config.device or "", sysfs)
        try:
            layout, scales = self._set_up(config)
            self.clock = self._choose_clock()
            self._decoder = Decoder(layout, scales, config.rate)
            node = nodes / self._directory.name
            self._fd = os.open(node, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            self._poll = select.poll()
            self._poll.register(self._fd, select.POLLIN)
            try:
                self._write("buffer/enable", "1")
            except OSError:
                os.close(self._fd)
                raise
        except (OSError, BadLayout, ValueError) as error:
            raise DeviceLost(_reason(error)) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._fd)
        try:
            self._write("buffer/enable", "0")
        except OSError as error:
            logger.debug("%s", error)  # it may be gone

    def read(self, timeout_s: float) -> list[ImuSample]:
        """What has come; waits for it up to the limit.

        Raises:
            DeviceLost: It is there no more.
        """
        events = self._poll.poll(timeout_s * 1e3)
        if not events:
            return []
        try:
            data = os.read(self._fd, _READ_BYTES)
        except BlockingIOError:
            return []
        except OSError as error:
            raise DeviceLost(_reason(error)) from error
        if not data:
            raise DeviceLost("it delivers nothing more")
        now = Now(self._utc_ns(), time.clock_gettime_ns(_CLOCKS[self.clock]))
        return self._decoder.samples(data, now)

    def _set_up(self, config: GyroConfig) -> tuple[Layout, dict[str, Scale]]:
        """Enables the gyro's channels and no other."""
        if not self._has("buffer/enable"):
            raise DeviceLost(f"{self._name} has no buffer; its driver only gives single values")
        self._write("buffer/enable", "0")
        wanted = {name for name in AXES if self._has(f"scan_elements/{name}_en")}
        if AXES["xyz".index(config.axis[-1])] not in wanted:
            raise DeviceLost(f"{self._name} has no gyro for axis {config.axis[-1]}")
        scales = {name: self._scale(name) for name in wanted}
        elements = []
        for switch in sorted(self._directory.glob("scan_elements/*_en")):
            name = switch.name.removesuffix("_en")
            enabled = name in wanted or name == TIMESTAMP
            self._write(f"scan_elements/{switch.name}", str(int(enabled)))
            if enabled:
                elements.append(self._element(name))
        self._set_rate(config.rate)
        self._set_trigger()
        self._write("buffer/length", str(max(2, math.ceil(config.rate * BUFFERED_S))))
        if self._has("buffer/watermark"):
            self._write("buffer/watermark", "1")
        return Layout(elements), scales

    def _element(self, name: str) -> Element:
        index, described = (
            self._read(f"scan_elements/{name}_{what}") for what in ("index", "type")
        )
        return element(name, index, described)

    def _scale(self, name: str) -> Scale:
        values = []
        for what, default in (("scale", None), ("offset", "0")):
            text = next(
                (
                    self._read(f"{stem}_{what}")
                    for stem in (name, "in_anglvel")
                    if self._has(f"{stem}_{what}")
                ),
                default,
            )
            if text is None:
                raise DeviceLost(f"{self._name} tells no {name}_scale")
            value = float(text)
            if not abs(value) <= _MOST:
                raise DeviceLost(f"{name}_{what} is {text:.20}")
            values.append(value)
        return Scale(*values)

    def _set_rate(self, rate: float) -> None:
        for name in ("in_anglvel_sampling_frequency", "sampling_frequency"):
            if self._has(name):
                try:
                    self._write(name, f"{rate:g}")
                except OSError as error:
                    logger.warning(
                        "%s does not take %g samples a second (%s); it stays at %s",
                        self._name,
                        rate,
                        error.strerror,
                        self._read(name),
                    )
                return

    def _set_trigger(self) -> None:
        """A device without a buffer of its own needs someone to say when; mostly it has its own."""
        if not self._has("trigger/current_trigger") or self._read("trigger/current_trigger"):
            return
        for path in sorted(self._directory.parent.glob("trigger*")):
            trigger = (path / "name").read_text(encoding="utf-8").strip()
            if trigger.startswith(self._name):
                self._write("trigger/current_trigger", trigger)
                return
        raise DeviceLost(
            f"nothing triggers {self._name}: make a trigger "
            "(mkdir /sys/kernel/config/iio/triggers/hrtimer/wackel) and write its name into "
            f"{self._directory}/trigger/current_trigger"
        )

    def _choose_clock(self) -> str:
        if not self._has("current_timestamp_clock"):
            return "realtime"  # before Linux 4.9 there was no other
        try:
            self._write("current_timestamp_clock", _BEST_CLOCK)
        except OSError as error:
            logger.warning("%s: %s", self._name, error)
        clock = self._read("current_timestamp_clock")
        if clock not in _CLOCKS:
            raise DeviceLost(f"it stamps by the clock {clock!r}, which is not known")
        return clock

    @property
    def _name(self) -> str:
        return _name_of(self._directory)

    def _has(self, name: str) -> bool:
        return (self._directory / name).exists()

    def _read(self, name: str) -> str:
        return (self._directory / name).read_text(encoding="utf-8").strip()

    def _write(self, name: str, text: str) -> None:
        # Without O_CREAT, which sysfs answers with a misleading "no permission".
        fd = os.open(self._directory / name, os.O_WRONLY | os.O_CLOEXEC)
        try:
            os.write(fd, text.encode())
        finally:
            os.close(fd)


def find(wanted: str, sysfs: Path) -> Path:
    """The directory of a device in sysfs.

    Args:
        wanted: Its name or path.
        sysfs: Where /sys is looked for.

    Raises:
        DeviceLost: There is none, or there are several; the text lists what is there.
    """
    directories = sorted(sysfs.glob("bus/iio/devices/iio:device*"))
    found = [each for each in directories if wanted in (_name_of(each), each.name)]
    if "/" in wanted:
        found = [each for each in directories if Path(wanted).name == each.name]
    if len(found) == 1:
        return found[0]
    known = ", ".join(f"{_name_of(each)} ({each.name})" for each in directories) or "none"
    how_many = "several IIO devices" if found else "no IIO device"
    raise DeviceLost(f"there is {how_many} {wanted!r}; there are {known}")


def _name_of(directory: Path) -> str:
    try:
        return (directory / "name").read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return directory.name


def _reason(error: Exception) -> str:
    if not isinstance(error, OSError) or error.strerror is None:
        return str(error)
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"no permission for {error.filename}; compose/udev has a rule"
    if error.errno in (errno.ENODEV, errno.ENXIO, errno.EIO):
        return "it was unplugged"
    return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
