"""Reading recordings: whole, unfinished, cut off anywhere, damaged; what is lost is said.

The library's own reader needs the index that only a finished file has, and trusts the lengths
it finds. Here each record is taken by itself: one that is damaged costs what it holds.
"""

import os
import stat
import struct
from collections.abc import Callable, Iterable, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Statistics
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from wackel_node.errors import Explained
from wackel_recording.about import METADATA_NAME, About
from wackel_schemas.keys import ROOT

_IS_MESSAGE, _IS_CHANNEL = int(Opcode.MESSAGE), int(Opcode.CHANNEL)  # members are slow to look up
_HEAD = struct.Struct("<BQ")  # opcode, length (MCAP specification, Records)
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log_time, publish_time

# zstd, lz4, mcap and struct each raise errors of their own on bytes that are not what they seem.
_DAMAGED = Exception

Wanted = Callable[[str], bool]


class Unreadable(Explained, ValueError):
    """No recording of wackel, or none that can be used; the text is one line with the file."""


class Empty(Unreadable):
    """Not a byte is in the file: it was begun a moment ago, or a loss of power emptied it."""


class Entry(NamedTuple):
    """One recorded message.

    Attributes:
        key: Below the robot's name.
        arrived_ns: When the recorder got it, UTC ns; never runs backwards in one recording.
        stamp_ns: The message's own stamp, UTC ns.
        payload: As it came.
    """

    key: str
    arrived_ns: int
    stamp_ns: int
    payload: bytes


class RecordingFile:
    """One file of a recording.

    Attributes:
        path: Of the file.
        about: Whose recording it is.
        size: Bytes.
        position: Bytes read so far by :meth:`entries`.
        damage: What :meth:`entries` could not read, in words; empty for a finished, sound file.
    """

    def __init__(self, path: Path) -> None:
        """Reads no further than to what the file says of itself.

        Raises:
            Empty: Nothing is in it.
            Unreadable: Not there, no MCAP, or none of wackel's.
        """
        self.path = path
        self.position = 0
        self.damage: list[str] = []
        self._channels: dict[int, str | None] = {}  # the key below the robot's name, if wanted
        self._found = 0
        self._nameless = 0
        try:
            if not stat.S_ISREG(path.stat().st_mode):
                raise Unreadable(f"{path}: not a file")
            with path.open("rb") as file:
                self.size = os.fstat(file.fileno()).st_size
                if not self.size:
                    raise Empty(f"{path}: empty, so just begun or lost with the power")
                self.about = self._find_about(file)
        except OSError as error:
            raise Unreadable(f"{path}: {error.strerror}") from error
        self._prefix = f"{ROOT}/{self.about.robot}/"

    def entries(self, wanted: Wanted = lambda _: True) -> Iterator[Entry]:
        """The messages in the order of their arrival.

        Args:
            wanted: Whether messages of a key are; asked once a key.
        """
        self.damage = []
        self._channels = {}
        self._found = self._nameless = 0
        promised: int | None = None
        with self.path.open("rb") as file:
            for at, opcode, body in self._records(file):
                self.position = at
                try:
                    match opcode:
                        case Opcode.CHUNK:
                            yield from self._messages(_unpack(body), wanted)
                        case Opcode.CHANNEL | Opcode.MESSAGE:
                            yield from self._messages(_HEAD.pack(opcode, len(body)) + body, wanted)
                        case Opcode.STATISTICS:
                            promised = Statistics.read(_stream(body)).message_count
                except _DAMAGED as error:
                    self._note(f"{len(body)} bytes at byte {at} are damaged ({error})")
        self.position = self.size
        if self._nameless:
            self._note(f"{self._nameless} messages belong to a key whose name is lost")
        if promised is not None and self._found < promised:
            self._note(f"{promised - self._found} of {promised} messages are lost")

    def _find_about(self, file: BinaryIO) -> About:
        if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise Unreadable(f"{self.path}: not an MCAP file")
        for _, opcode, body in self._records(file):
            if opcode != Opcode.METADATA:
                continue
            try:
                metadata = Metadata.read(_stream(body))
                if metadata.name == METADATA_NAME:
                    return About.from_metadata(metadata.metadata)
            except _DAMAGED as error:
                raise Unreadable(f"{self.path}: its head is damaged ({error})") from error
        if self.damage:
            raise Unreadable(f"{self.path}: cut off before it says whose recording it is")
        raise Unreadable(f"{self.path}: an MCAP file, but no recording of wackel")

    def _records(self, file: BinaryIO) -> Iterator[tuple[int, int, bytes]]:
        """Every whole record as (offset, opcode, content)."""
        file.seek(len(MCAP0_MAGIC))
        while True:
            at = file.tell()
            # Who still writes it may have come further since it was opened.
            head = file.read(min(_HEAD.size, self.size - at))
            if not head:
                self._note("it was not finished; at most the last second is missing")
                return
            if len(head) < _HEAD.size:
                self._note(f"it ends within a record; the last {self.size - at} bytes are lost")
                return
            opcode, length = _HEAD.unpack(head)
            if opcode == 0 or at + _HEAD.size + length > self.size:
                self._note(f"nothing can be read behind byte {at} of {self.size}")
                return
            yield at, opcode, file.read(length)
            if opcode == Opcode.FOOTER:
                return

    def _messages(self, data: bytes, wanted: Wanted) -> Iterator[Entry]:
        """The wanted messages among packed records."""
        here = 0
        while here < len(data):
            opcode, length = _HEAD.unpack_from(data, here)
            here += _HEAD.size
            if opcode == _IS_MESSAGE:
                channel, _, arrived_ns, stamp_ns = _MESSAGE.unpack_from(data, here)
                self._found += 1
                key = self._channels.get(channel, "")
                if key:
                    payload = data[here + _MESSAGE.size : here + length]
                    yield Entry(key, arrived_ns, stamp_ns, payload)
                elif key is not None:
                    self._nameless += 1
            elif opcode == _IS_CHANNEL:
                self._learn(Channel.read(_stream(data[here : here + length])), wanted)
            here += length

    def _learn(self, channel: Channel, wanted: Wanted) -> None:
        key = channel.topic.removeprefix(self._prefix)
        if key == channel.topic and channel.id not in self._channels:
            self._note(f"its head is of robot {self.about.robot!r}, the key {key!r} of another")
        self._channels[channel.id] = key if key != channel.topic and wanted(key) else None

    def _note(self, text: str) -> None:
        self.damage.append(f"{self.path}: {text}")


def _unpack(body: bytes) -> bytes:
    """The records in a chunk."""
    stream, length = get_chunk_data_stream(Chunk.read(_stream(body)), validate_crc=True)
    return stream.read(length)


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))


class Recording:
    """One session of recording: its files in order.

    Attributes:
        files: In order.
        about: Of the first file.
        empty: What is said of files beside them in which nothing is.
    """

    def __init__(self, files: list[RecordingFile]) -> None:
        self.files = sorted(files, key=lambda file: file.about.part)
        self.about = self.files[0].about
        self.empty: list[str] = []

    @property
    def progress(self) -> float:
        """Share of the files that :meth:`entries` has read, 0 … 1."""
        return sum(file.position for file in self.files) / sum(file.size for file in self.files)

    @property
    def damage(self) -> list[str]:
        """What was lost, in words, as far as it was read."""
        parts = [file.about.part for file in self.files]
        missing = [
            f"{file.path}: part {before + 1} of the recording, which comes before it, is not here"
            for before, file in zip(parts, self.files[1:], strict=False)
            if file.about.part > before + 1
        ]
        return missing + self.empty + [text for file in self.files for text in file.damage]

    def doubt(self, robot: str) -> str:
        """What to say before it is concluded from with a robot's configuration; empty: nothing."""
        if robot == self.about.robot:
            return ""
        return (
            f"{self.files[0].path} is of robot {self.about.robot!r}, the configuration of "
            f"{robot!r}: what is concluded holds only if they are built alike"
        )

    def entries(self, wanted: Wanted = lambda _: True) -> Iterator[Entry]:
        """The messages of all files; see :meth:`RecordingFile.entries`."""
        for file in self.files:
            file.position = 0
        for file in self.files:
            yield from file.entries(wanted)


def open_recordings(paths: Iterable[Path]) -> list[Recording]:
    """The recordings that the files belong to, in the order in which they were made.

    Args:
        paths: Files in any order; a directory stands for all ``.mcap`` files in it. Files in
            which nothing is are damage of the last recording, for whose they are none tells.

    Raises:
        Unreadable: One of them is none, a directory holds none, or nothing is in any.
    """
    sessions: dict[str, dict[Path, RecordingFile]] = {}
    empty: dict[Path, str] = {}
    for path in paths:
        try:
            inside = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        except OSError as error:  # a directory that is not this user's
            raise Unreadable(f"{path}: {error.strerror}") from error
        if not inside:
            raise Unreadable(f"{path}: no .mcap file in it")
        for each in inside:
            try:
                file = RecordingFile(each)
            except Empty as error:
                empty[each.resolve()] = str(error)
            else:
                sessions.setdefault(file.about.session, {})[each.resolve()] = file
    recordings = [Recording(list(files.values())) for files in sessions.values()]
    recordings.sort(key=lambda recording: recording.about.started_ns)
    if empty:
        if not recordings:
            raise Unreadable(next(iter(empty.values())))
        recordings[-1].empty = [*empty.values()]
    return recordings
