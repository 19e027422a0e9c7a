"""Health in files that survive ``kill -9`` at any moment, and loss of power but for a second.

It is written before it is published, so that no number of a transition is ever given twice.
Writing must then cost less than health may be late: it goes over the oldest of four slots, which
takes microseconds and is all that a killed process needs. :meth:`Store.commit` has a thread bring
the newest slot to the disk, which may take a tenth of a second; the slot that is on its way there,
and the one that got there last, are not touched before another has.
"""

import errno
import fcntl
import os
import struct
import zlib
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Self

from wackel_node.errors import Explained
from wackel_node.log import logger
from wackel_schemas import wire
from wackel_schemas.health import Health

_SLOTS = 4  # the newest, one on its way to the disk, the one that got there, one to write
_HEAD = struct.Struct(">8sQII")  # magic, serial number, length of the health, CRC-32 of all of it
_MAGIC = b"wackel-1"


class Taken(Explained):
    """Another aggregator of the same robot keeps its state here."""


class Store:
    """One robot's state files. Use with ``with``: meanwhile no second aggregator gets them.

    What cannot be written is told once; health goes on without memory.
    """

    def __init__(self, directory: Path, robot: str) -> None:
        """Opens the directory, which is made if need be.

        Raises:
            Taken: Another aggregator has it.
        """
        self._path = directory / f"{robot}.health"
        self._serial = 0
        self._newest: int | None = None  # numbers of slots
        self._durable: int | None = None
        self._under_way: tuple[int, Future[None]] | None = None
        self._disk = ThreadPoolExecutor(1, "disk")
        self._failing = False
        self._slots = self._open()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._notice(wait=True)
        self.commit()
        self._notice(wait=True)
        self._disk.shutdown()
        for slot in self._slots:
            os.close(slot)

    def load(self) -> Health | None:
        """The latest complete health; if nothing there is complete, that is set aside and told."""
        contents = [self._read(slot) for slot in self._slots]
        complete = [_unpack(content) for content in contents]
        self._serial, health, self._newest = max(
            ((*found, number) for number, found in enumerate(complete) if found is not None),
            key=lambda found: found[0],
            default=(0, None, None),
        )
        self.commit()
        if health is None and any(contents):
            aside = self._path.with_suffix(".broken")
            logger.warning("%s is broken; starting without memory, see %s", self._path, aside)
            try:
                aside.write_bytes(b"".join(contents))
            except OSError as error:
                self._fail(error)
        return health

    def prepare(self, health: bytes) -> None:
        """Makes an encoded health survive the death of this process."""
        if not self._slots:
            return
        self._serial += 1
        data = _pack(self._serial, health)
        number = self._oldest()
        try:
            if os.pwrite(self._slots[number], data, 0) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            self._fail(error)
        else:
            self._newest = number
            self._failing = False

    def commit(self) -> None:
        """Has the newest health survive the loss of power; the disk is not waited for."""
        self._notice()
        if self._under_way is None and self._newest not in (None, self._durable):
            written = self._disk.submit(os.fdatasync, self._slots[self._newest])
            self._under_way = self._newest, written

    def _notice(self, *, wait: bool = False) -> None:
        """Takes notice of a slot that has got to the disk."""
        if self._under_way is None:
            return
        number, written = self._under_way
        if not (wait or written.done()):
            return
        self._under_way = None
        try:
            written.result()
        except OSError as error:
            self._fail(error)
        else:
            self._durable = number

    def _oldest(self) -> int:
        """The slot to write next."""
        newest = -1 if self._newest is None else self._newest
        kept = self._durable, self._under_way[0] if self._under_way is not None else None
        slots = ((newest + step) % _SLOTS for step in range(1, _SLOTS))
        return next(number for number in slots if number not in kept)

    def _open(self) -> list[int]:
        directory = self._path.parent
        try:
            directory.mkdir(parents=True, exist_ok=True)
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC
            slots = [os.open(f"{self._path}.{number}", flags, 0o644) for number in range(_SLOTS)]
            handle = os.open(directory, os.O_RDONLY | os.O_CLOEXEC)
            os.fsync(handle)
            os.close(handle)
        except OSError as error:
            self._fail(error)
            return []
        try:
            fcntl.flock(slots[0], fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            for slot in slots:
                os.close(slot)
            raise Taken(f"another aggregator of this robot keeps {self._path}") from error
        return slots

    def _read(self, slot: int) -> bytes:
        try:
            return os.pread(slot, os.fstat(slot).st_size, 0)
        except OSError as error:
            self._fail(error)
            return b""

    def _fail(self, error: OSError) -> None:
        if not self._failing:
            self._failing = True
            logger.error("faults will not outlive a restart: %s: %s", self._path, error)


def _pack(serial: int, payload: bytes) -> bytes:
    return _HEAD.pack(_MAGIC, serial, len(payload), _checksum(serial, payload)) + payload


def _unpack(data: bytes) -> tuple[int, Health] | None:
    if len(data) < _HEAD.size:
        return None
    magic, serial, length, checksum = _HEAD.unpack_from(data)
    payload = data[_HEAD.size : _HEAD.size + length]
    if (magic, checksum) != (_MAGIC, _checksum(serial, payload)):
        return None
    try:
        return serial, wire.decode(payload, Health)
    except wire.Rejected as error:
        logger.warning("a saved state of another wackel: %s", error)
        return None


def _checksum(serial: int, payload: bytes) -> int:
    return zlib.crc32(payload, serial & 0xFFFFFFFF)
