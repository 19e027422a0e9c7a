"""The state in a file that survives ``kill -9`` at any moment, and loss of power up to a second.

A new state is written beside the old one before it is published, which costs microseconds and is
all that a killed process needs; bringing it to the disk and in the old one's place may take an SD
card 100 ms, is done by :meth:`Store.commit` and is not in the way of health.
"""

import fcntl
import os
import zlib
from pathlib import Path
from typing import Self

from wackel_aggregator.state import State
from wackel_node.errors import Explained
from wackel_node.log import logger
from wackel_schemas import wire

_MAGIC = b"wackel health 1\n"
_CHECKSUM_BYTES = 4


class Taken(Explained):
    """Another aggregator of the same robot keeps its state here."""


class Store:
    """One robot's state file. Use with ``with``: meanwhile no second aggregator gets it.

    A directory that cannot be written is reported once; health goes on without memory.
    """

    def __init__(self, directory: Path, robot: str) -> None:
        """Opens the directory, which is made if need be.

        Raises:
            Taken: Another aggregator has it.
        """
        self._path = directory / f"{robot}.health"
        self._new = self._path.with_suffix(".health.new")
        self._pending = False
        self._usable = True
        self._lock = self._take(directory / f"{robot}.lock")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.commit()
        if self._lock is not None:
            os.close(self._lock)

    def load(self) -> State | None:
        """The latest complete state; a broken file is set aside with a warning."""
        if not self._usable:
            return None
        # The newer file is incomplete if power was lost before it was on the disk.
        return _read(self._new, keep_broken=False) or _read(self._path, keep_broken=True)

    def prepare(self, state: State) -> None:
        """Makes a state survive the death of this process."""
        if not self._usable:
            return
        payload = wire.encode(state)
        try:
            written = self._new.with_suffix(".part")
            written.write_bytes(_MAGIC + _checksum(payload) + payload)
            written.replace(self._new)
            self._pending = True
        except OSError as error:
            self._give_up(error)

    def commit(self) -> None:
        """Makes the latest state survive the loss of power; blocks while the disk writes."""
        if not (self._usable and self._pending):
            return
        try:
            _sync(self._new)
            self._new.replace(self._path)
            _sync(self._path.parent)
        except OSError as error:
            self._give_up(error)
        self._pending = False

    def _take(self, path: Path) -> int | None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            self._give_up(error)
            return None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(lock)
            raise Taken(f"another aggregator of this robot is running (lock {path})") from error
        return lock

    def _give_up(self, error: OSError) -> None:
        logger.error("faults will not outlive a restart: %s", error)
        self._usable = False


def _read(path: Path, keep_broken: bool) -> State | None:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        logger.error("cannot read %s: %s", path, error)
        return None
    start = len(_MAGIC) + _CHECKSUM_BYTES
    payload = data[start:]
    if data[:start] == _MAGIC + _checksum(payload):
        try:
            return wire.decode(payload, State)
        except wire.Rejected as error:
            logger.warning("%s: %s", path, error)
    if keep_broken:
        aside = path.with_suffix(".broken")
        logger.warning("%s is broken; starting without memory, see %s", path, aside)
        path.replace(aside)
    return None


def _checksum(payload: bytes) -> bytes:
    return zlib.crc32(payload).to_bytes(_CHECKSUM_BYTES, "big")


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
