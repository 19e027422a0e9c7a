"""Bytes of an IIO buffer to samples. Pure: the time of reading comes in."""

from collections.abc import Mapping
from typing import NamedTuple

from wackel_imu.scan import Layout
from wackel_schemas.drive import ImuSample

AXES = ("in_anglvel_x", "in_anglvel_y", "in_anglvel_z")
TIMESTAMP = "in_timestamp"
MOST_OFF_NS = 3_600_000_000_000
"""A stamp that is further off, which no clock is, is told as being so far off."""


class Scale(NamedTuple):
    """From raw values to rad/s: (raw + offset) × scale."""

    scale: float
    offset: float = 0.0


class Now(NamedTuple):
    """One moment on two clocks.

    Attributes:
        utc_ns: UTC.
        device_ns: The clock by which the device stamps.
    """

    utc_ns: int
    device_ns: int


class Decoder:
    """Decodes what is read from one device.

    Args:
        layout: Of a scan.
        scales: Of the axes that it has; the others show 0.
        rate: Samples per second, for a device that does not stamp.
    """

    def __init__(self, layout: Layout, scales: Mapping[str, Scale], rate: float) -> None:
        self._layout = layout
        self._axes = [(name, scales.get(name)) for name in AXES]
        self._stamped = TIMESTAMP in layout
        self._period_ns = round(1e9 / rate)
        self._rest = b""

    def samples(self, data: bytes, now: Now) -> list[ImuSample]:
        """The samples in what was read; what is left of a scan waits for the next read.

        Args:
            data: As read.
            now: When that was.
        """
        size = self._layout.size
        data = self._rest + data
        whole = len(data) // size
        self._rest = data[whole * size :]
        scans = [data[k * size : (k + 1) * size] for k in range(whole)]
        return [
            ImuSample(
                stamp=now.utc_ns - self._age_ns(scan, whole - 1 - k, now),
                angular_velocity=self._rates(scan),
            )
            for k, scan in enumerate(scans)
        ]

    def _age_ns(self, scan: bytes, newer: int, now: Now) -> int:
        """How old a scan is that ``newer`` others follow."""
        if self._stamped:
            age_ns = now.device_ns - self._layout.value(TIMESTAMP, scan)
            return max(-MOST_OFF_NS, min(age_ns, MOST_OFF_NS))
        return newer * self._period_ns

    def _rates(self, scan: bytes) -> tuple[float, float, float]:
        x, y, z = (
            0.0 if scale is None else (self._layout.value(name, scan) + scale.offset) * scale.scale
            for name, scale in self._axes
        )
        return x, y, z
