"""A gyro as the kernel shows it: a directory tree in the shape of sysfs, and a node to read."""

import os
import struct
from pathlib import Path

SCAN = struct.Struct("<hhh2xq")
"""What the types in :func:`gyro` make of x, y, z and the timestamp."""
SCALE = 0.000152716  # LSM6DSL at 8.75 mdps per step


class Tree:
    """One device.

    Attributes:
        sysfs, nodes: In the place of /sys and /dev.
        directory: Of the device.
        node: A FIFO.
    """

    def __init__(self, root: Path, number: int = 0, name: str = "lsm6dsl_gyro") -> None:
        self.sysfs, self.nodes = root / "sys", root / "dev"
        self.directory = self.sysfs / f"bus/iio/devices/iio:device{number}"
        self.node = self.nodes / f"iio:device{number}"
        self.nodes.mkdir(exist_ok=True)
        os.mkfifo(self.node)
        for index, axis in enumerate("xyz"):
            self.channel(f"in_anglvel_{axis}", index, "le:s16/16>>0")
        self.channel("in_temp", 6, "le:s16/16>>0", enabled="1")
        self.channel("in_timestamp", 3, "le:s64/64>>0")
        self.put("name", name)
        self.put("in_anglvel_scale", f"{SCALE:.9f}")
        self.put("sampling_frequency", "12.5")
        self.put("current_timestamp_clock", "realtime")
        self.put("buffer/enable", "0")
        self.put("buffer/length", "2")
        self.put("buffer/watermark", "2")

    def channel(self, name: str, index: int, described: str, enabled: str = "0") -> None:
        for what, text in (("en", enabled), ("index", str(index)), ("type", described)):
            self.put(f"scan_elements/{name}_{what}", text)

    def put(self, name: str, text: str) -> None:
        path = self.directory / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")

    def get(self, name: str) -> str:
        """The first line of a file: what the driver would take of a write."""
        return (self.directory / name).read_text().split("\n")[0]

    def feeder(self) -> int:
        """A descriptor for writing scans; opens as soon as somebody reads."""
        return os.open(self.node, os.O_WRONLY | os.O_NONBLOCK)
