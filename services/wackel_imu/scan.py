"""The layout of a buffered IIO scan: which channel stands where, and how its bits are to be read.

Source: Linux, Documentation/ABI/testing/sysfs-bus-iio, "scan_elements", and iio_compute_scan_bytes
in drivers/iio/industrialio-buffer.c: elements in the order of their index, each aligned to its own
length; the whole to the longest.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

_TYPE = re.compile(
    r"(?P<order>[lb]e):(?P<sign>[su])(?P<bits>\d{1,3})/(?P<storage>\d{1,3})"
    r"(?:X(?P<repeat>\d{1,3}))?>>(?P<shift>\d{1,3})",
    re.ASCII,
)


class BadLayout(ValueError):
    """A description that no driver gives; the text says what was expected."""


@dataclass(frozen=True)
class Element:
    """One channel.

    Attributes:
        name: As in sysfs, ``in_anglvel_z``.
        index: Its place among all channels.
        big_endian, signed: How the bytes are to be read.
        bits: That count.
        storage: Bytes in which they stand.
        shift: By how much to shift them to the right.
        repeat: How many values of this kind follow each other; only the first is read.
    """

    name: str
    index: int
    big_endian: bool
    signed: bool
    bits: int
    storage: int
    shift: int = 0
    repeat: int = 1

    @property
    def length(self) -> int:
        """Bytes of the whole."""
        return self.storage * self.repeat


def element(name: str, index: str, described: str) -> Element:
    """A channel as its files describe it: ``2``, ``le:s16/16>>0``.

    Raises:
        BadLayout: They do not.
    """
    found = _TYPE.fullmatch(described.strip())
    if found is None:
        raise BadLayout(f"{name}: type {described.strip()!r:.60} is not like 'le:s16/16>>0'")
    bits, storage, shift = (int(found[key]) for key in ("bits", "storage", "shift"))
    if bits == 0 or bits + shift > storage or storage not in (8, 16, 32, 64):
        raise BadLayout(f"{name}: {bits} bits, shifted by {shift}, do not fit {storage} bits")
    if not re.fullmatch(r"\d{1,4}\s*", index, re.ASCII):
        raise BadLayout(f"{name}: index {index.strip()!r:.60} is no number")
    repeat = int(found["repeat"] or 1)
    if not repeat:
        raise BadLayout(f"{name}: repeated 0 times")
    return Element(
        name=name,
        index=int(index),
        big_endian=found["order"] == "be",
        signed=found["sign"] == "s",
        bits=bits,
        storage=storage // 8,
        shift=shift,
        repeat=repeat,
    )


class Layout:
    """Where the enabled channels stand in a scan.

    Attributes:
        size: Bytes of a scan.

    Raises:
        BadLayout: Two channels have the same name or index, or there is none.
    """

    def __init__(self, elements: Iterable[Element]) -> None:
        ordered = sorted(elements, key=lambda each: each.index)
        if not ordered:
            raise BadLayout("no channel is enabled")
        if len({each.index for each in ordered}) < len(ordered):
            raise BadLayout("two channels have the same index")
        self._places: dict[str, tuple[int, Element]] = {}
        end = 0
        for each in ordered:
            start = _aligned(end, each.length)
            self._places[each.name] = start, each
            end = start + each.length
        if len(self._places) < len(ordered):
            raise BadLayout("two channels have the same name")
        self.size = _aligned(end, max(each.length for each in ordered))

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def value(self, name: str, scan: bytes) -> int:
        """The raw value of a channel.

        Args:
            name: Of a channel that is there.
            scan: :attr:`size` bytes.
        """
        start, each = self._places[name]
        stored = scan[start : start + each.storage]
        raw = int.from_bytes(stored, "big" if each.big_endian else "little") >> each.shift
        raw &= (1 << each.bits) - 1
        return raw - (1 << each.bits) if each.signed and raw >> (each.bits - 1) else raw


def _aligned(offset: int, length: int) -> int:
    return -(-offset // length) * length
