"""Writing a recording: MCAP files that lose little in a crash, a new one after so much."""

import errno
import glob
import os
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import msgspec
from mcap.writer import CompressionType, Writer

from wackel_recording.about import METADATA_NAME, PROFILE, About
from wackel_schemas.keys import ROOT, topic_of
from wackel_schemas.message import Message

FLUSH_S = 0.5
"""How often :meth:`RecordingWriter.flush` is to be called: half of what a crash may cost."""

# A full disk takes the robot's other programs down with it, so recording ends before that.
RESERVE_BYTES = 256 * 2**20

# Far beyond a robot's topics: strangers may write on any number of keys, MCAP counts to 65535.
MAX_KEYS = 1024

_U64 = 2**64
_U32 = 2**32


class RecordingWriter:
    """Writes one recording.

    ``log_time`` in the files is the time of arrival, so that it never runs backwards and a
    playback has the spacing that subscribers saw; ``publish_time`` is the message's own stamp.

    Attributes:
        path: The file in progress; ``None`` before the first message and after :meth:`abandon`.
        messages, foreign, undecodable: Written in all; of these on keys that are not wackel's;
            of these on wackel's keys, but without a message's header. Both are kept as they came.
        lost: Of ``messages``, those that a disk then did not take, at most.
        refused: Not written, because there are too many keys.
        reserve_bytes: Space on the disk that is left to others.
    """

    def __init__(
        self,
        output: Path,
        about: About,
        max_bytes: int | None = None,
        max_s: float | None = None,
        reserve_bytes: int = RESERVE_BYTES,
    ) -> None:
        """Opens nothing yet.

        Args:
            output: A name ending in ``.mcap`` is the first file, and later ones are numbered
                after it; any other is a directory, made if need be, and files are named after
                robot and time.
            about: Whose recording.
            max_bytes, max_s: A new file after so much; none is ever cut within a message.
            reserve_bytes: Space on the disk that is left to others.
        """
        self._output = output
        self._about = about
        self._max_bytes = max_bytes
        self._max_ns = None if max_s is None else int(max_s * 1e9)
        self.reserve_bytes = reserve_bytes
        self._file: _File | None = None
        self._unstored = 0  # messages since the last flush
        self._closed_bytes = 0
        self._next_part = about.part
        # To the medium in a thread, because an SD card may take seconds for it.
        self._worker = ThreadPoolExecutor(1, "sync")
        self._closing: list[Future[None]] = []
        self.messages = 0
        self.lost = 0
        self.foreign = 0
        self.undecodable = 0
        self.refused = 0

    @property
    def path(self) -> Path | None:
        """The file in progress."""
        return None if self._file is None else self._file.path

    @property
    def stored_bytes(self) -> int:
        """Size of all files so far."""
        return self._closed_bytes + (0 if self._file is None else self._file.size)

    def open(self) -> None:
        """Opens the next file, which :meth:`add` does by itself when it needs one.

        Raises:
            OSError: It cannot be written, or later parts of another recording lie there, which
                this one would run into.
        """
        path = self._path(self._next_part)
        path.parent.mkdir(parents=True, exist_ok=True)
        if self._next_part == 0 and self._output.suffix == ".mcap":
            for later in path.parent.glob(f"{glob.escape(path.stem)}_[0-9][0-9][0-9]*.mcap"):
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(later))
        self._check_space(path.parent)
        self._file = _File(path, replace(self._about, part=self._next_part), self._worker)
        self._next_part += 1

    def add(self, key: str, arrived_ns: int, payload: bytes, header: Message | None) -> None:
        """Adds one message; in memory until the next :meth:`flush`.

        Args:
            key: Below the robot's name.
            arrived_ns: UTC, ns.
            payload: As it came.
            header: As :func:`wackel_node.listen.header_of` finds it.

        Raises:
            OSError: The next file cannot be opened.
        """
        if self._file is None:
            self.open()
        assert self._file is not None
        if not self._file.add(f"{ROOT}/{self._about.robot}/{key}", arrived_ns, payload, header):
            self.refused += 1
            return
        self.messages += 1
        self._unstored += 1
        if header is None:
            foreign = topic_of(key) is None
            self.foreign += foreign
            self.undecodable += not foreign

    def flush(self) -> None:
        """Brings to the system all that was added, so that a crash does not lose it.

        Raises:
            OSError: The disk is full, or about to be, or does not take it; see :meth:`abandon`.
        """
        file = self._file
        if file is None:
            return
        file.flush()
        self._unstored = 0
        try:
            self._look_at_closing()
            self._check_space(file.path.parent)
        except OSError:
            self._finish()
            raise
        if (self._max_bytes is not None and file.size >= self._max_bytes) or (
            self._max_ns is not None and file.span_ns >= self._max_ns
        ):
            self._finish()

    def close(self) -> None:
        """Ends the file in progress with its index, and waits until the medium has all files.

        Raises:
            OSError: As :meth:`flush`.
        """
        self._finish()
        wait(self._closing)
        self._look_at_closing()

    def abandon(self) -> None:
        """Lets go of a file that takes no more, with what it holds; the next message opens one."""
        self.lost += self._unstored
        self._unstored = 0
        if self._file is not None:
            self._file.release()
            self._closed_bytes += self._file.size
            self._file = None

    def _finish(self) -> None:
        """Ends the file in progress with its index; the next message opens a new one."""
        if self._file is not None:
            self._closing.append(self._file.finish())
            self._unstored = 0
            self._closed_bytes += self._file.size
            self._file = None

    def _look_at_closing(self) -> None:
        """Raises what the medium has not taken of a file that is finished."""
        done = [each for each in self._closing if each.done()]
        self._closing = [each for each in self._closing if not each.done()]
        for each in done:
            each.result()

    def _path(self, part: int) -> Path:
        if self._output.suffix != ".mcap":
            start = datetime.fromtimestamp(self._about.started_ns / 1e9, UTC)
            return self._output / f"{self._about.robot}_{start:%Y%m%dT%H%M%SZ}_{part:03}.mcap"
        if part == 0:
            return self._output
        return self._output.with_stem(f"{self._output.stem}_{part:03}")

    def _check_space(self, directory: Path) -> None:
        disk = os.statvfs(directory)
        free = disk.f_bavail * disk.f_frsize
        if free < self.reserve_bytes:
            raise OSError(
                f"only {free / 2**20:.0f} MiB are free, and {self.reserve_bytes / 2**20:.0f} MiB "
                "are left to the robot's other programs"
            )


class _File:
    """One MCAP file: channels and schemas as messages need them."""

    def __init__(self, path: Path, about: About, worker: Executor) -> None:
        self.path = path
        self.span_ns = 0
        self._first_ns: int | None = None
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._disk = _Disk(path, worker)
        self._writer = Writer(self._disk, compression=CompressionType.ZSTD)  # type: ignore[arg-type]
        self._writer.start(PROFILE, f"wackel {about.version}")
        self._writer.add_metadata(METADATA_NAME, about.to_metadata())
        try:
            self._disk.flush()
        except OSError:
            self.release()
            raise

    @property
    def size(self) -> int:
        return self._disk.stored

    def add(self, key: str, arrived_ns: int, payload: bytes, header: Message | None) -> bool:
        channel = self._channels.get(key)
        if channel is None:
            if len(self._channels) == MAX_KEYS:
                return False
            channel = self._channels[key] = self._register(key)
        if self._first_ns is None:
            self._first_ns = arrived_ns
        self.span_ns = arrived_ns - self._first_ns
        stamped = header is not None and 0 <= header.stamp < _U64
        self._writer.add_message(
            channel_id=channel,
            log_time=arrived_ns,
            publish_time=header.stamp if header is not None and stamped else arrived_ns,
            sequence=header.seq % _U32 if header is not None else 0,
            data=payload,
        )
        return True

    def _register(self, key: str) -> int:
        topic = topic_of(key.split("/", 2)[2])
        if topic is None:
            return self._writer.register_channel(key, message_encoding="", schema_id=0)
        name = topic.message.__name__
        if name not in self._schemas:
            schema = msgspec.json.encode(msgspec.json.schema(topic.message))
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", schema)
        return self._writer.register_channel(key, "msgpack", self._schemas[name])

    def flush(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> Future[None]:
        """Done when the medium has it."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._disk.flush()
        return self._disk.close()

    def release(self) -> None:
        self._disk.close()
        if self._disk.stored == 0:
            self.path.unlink(missing_ok=True)


class _Disk:
    """The file below the MCAP writer: takes all in memory, and errors come from :meth:`flush`.

    To the system at each flush, which is enough for a crash of the process; from there to the
    medium by the worker. A loss of power costs what that had not finished.
    """

    def __init__(self, path: Path, worker: Executor) -> None:
        self._path = path
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._pending = bytearray()
        self._taken = 0
        self.stored = 0
        self._worker = worker
        self._sync: Future[None] | None = None

    def write(self, data: bytes | memoryview) -> int:
        self._pending += data
        self._taken += len(data)
        return len(data)

    def tell(self) -> int:
        return self._taken

    def flush(self) -> None:
        if self._pending:
            data, self._pending = self._pending, bytearray()
            rest = memoryview(data)
            while rest:
                written = os.write(self._fd, rest)
                self.stored += written
                rest = rest[written:]
        if self._sync is None or self._sync.done():
            if self._sync is not None:
                self._sync.result()
            self._sync = self._worker.submit(_sync, self._fd, self._path)

    def close(self) -> Future[None]:
        """Done when the medium has what was flushed; what is still pending is lost."""
        return self._worker.submit(_close, self._fd, self._path, self._sync)


def _sync(fd: int, path: Path) -> None:
    try:
        os.fdatasync(fd)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def _close(fd: int, path: Path, before: Future[None] | None) -> None:
    """After the last sync, which the same worker has done: the system tells an error only once."""
    try:
        if before is not None:
            before.result()
        _sync(fd, path)
    finally:
        os.close(fd)
