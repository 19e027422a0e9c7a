"""Recordings as files: what is written is read back, and whatever is left after harm as well."""

import errno
import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC, Writer

from wackel_node.listen import header_of
from wackel_recording.about import About
from wackel_recording.reader import Entry, RecordingFile, Unreadable, open_recordings
from wackel_recording.writer import MAX_KEYS, RecordingWriter
from wackel_schemas import wire
from wackel_schemas.bus import BusState, ServoState
from wackel_schemas.message import Message

START_NS = 1_700_000_000_000_000_000
CONFIG = 'robot = "testbot"\n'
CHUNKS = 3
PER_CHUNK = 4


def about(session: str = "a", started_ns: int = START_NS) -> About:
    return About(
        robot="testbot", config=CONFIG, version="1", started_ns=started_ns, session=session
    )


def state(number: int) -> BusState:
    stamp = START_NS + number * 10_000_000
    return BusState(stamp=stamp, seq=number, servos=[ServoState(id=1, position=number / 7)])


def fill(writer: RecordingWriter, numbers: range) -> None:
    for number in numbers:
        message = state(number)
        writer.add("bus/main/state", message.stamp + 1000, wire.encode(message), message)


def numbers_in(entries: list[Entry]) -> list[int]:
    return [wire.decode(entry.payload, Message).seq for entry in entries]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A finished file of CHUNKS chunks with PER_CHUNK messages each."""
    path = tmp_path_factory.mktemp("sound") / "run.mcap"
    writer = RecordingWriter(path, about())
    for chunk in range(CHUNKS):
        fill(writer, range(chunk * PER_CHUNK, (chunk + 1) * PER_CHUNK))
        writer.flush()
    writer.close()
    return path.read_bytes()


def test_what_was_written_is_read_back_as_it_came(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path, about())
    fill(writer, range(10))
    writer.close()
    (recording,) = open_recordings([tmp_path])
    entries = list(recording.entries())
    assert [entry.payload for entry in entries] == [wire.encode(state(n)) for n in range(10)]
    assert entries[3] == (
        "bus/main/state",
        state(3).stamp + 1000,
        state(3).stamp,
        wire.encode(state(3)),
    )
    assert recording.about == about()
    assert recording.damage == []
    assert recording.progress == 1.0


def test_the_mcap_library_reads_a_recording(sound: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(sound)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "wackel"
        (metadata,) = reader.iter_metadata()
        assert metadata.metadata["config"] == CONFIG
        messages = list(reader.iter_messages())
    assert len(messages) == CHUNKS * PER_CHUNK
    schema, channel, message = messages[7]
    assert schema is not None
    assert (schema.name, schema.encoding) == ("BusState", "jsonschema")
    assert (channel.topic, channel.message_encoding) == (
        "wackel/testbot/bus/main/state",
        "msgpack",
    )
    assert (message.log_time, message.publish_time, message.sequence) == (
        state(7).stamp + 1000,
        state(7).stamp,
        7,
    )


def test_only_wanted_keys_are_read(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path, about())
    fill(writer, range(3))
    writer.add("bus/main/command", START_NS, wire.encode(state(0)), state(0))
    writer.close()
    (recording,) = open_recordings([tmp_path])
    entries = list(recording.entries(lambda key: key.endswith("command")))
    assert [entry.key for entry in entries] == ["bus/main/command"]


@pytest.mark.parametrize(
    ("key", "payload", "foreign", "undecodable"),
    [
        ("camera/front", b"\xff\xd8 anything", 1, 0),
        ("bus/main/state", b"\xc1 no MessagePack", 0, 1),
        ("bus/main/state", b"", 0, 1),
        ("bus/main/state", wire.encode(Message(stamp=-5)), 0, 0),
        ("bus/main/state", wire.encode(Message(stamp=2**64 - 1, seq=2**40)), 0, 0),
    ],
)
def test_what_is_not_understood_is_kept_as_it_came_and_counted(
    tmp_path: Path, key: str, payload: bytes, foreign: int, undecodable: int
) -> None:
    writer = RecordingWriter(tmp_path, about())
    writer.add(key, START_NS, payload, header_of(key, payload))
    writer.close()
    (recording,) = open_recordings([tmp_path])
    (entry,) = recording.entries()
    assert (entry.key, entry.payload) == (key, payload)
    assert (writer.foreign, writer.undecodable) == (foreign, undecodable)


def test_messages_on_ever_more_keys_are_refused_and_counted(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path, about())
    for number in range(MAX_KEYS + 3):
        writer.add(f"foreign/{number}", START_NS, b"x", None)
    writer.close()
    (recording,) = open_recordings([tmp_path])
    assert len(list(recording.entries())) == writer.messages == MAX_KEYS
    assert writer.refused == 3


def test_a_new_file_begins_after_so_many_seconds_and_all_are_read_in_order(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path, about(), max_s=0.09)  # ten messages of 10 ms
    for number in range(35):
        fill(writer, range(number, number + 1))
        writer.flush()
    writer.close()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"testbot_20231114T221320Z_{part:03}.mcap" for part in range(4)]
    (recording,) = open_recordings([tmp_path / name for name in reversed(names)])
    assert numbers_in(list(recording.entries())) == list(range(35))
    assert recording.damage == []


def test_a_new_file_begins_after_so_many_bytes_and_is_named_after_the_first(
    tmp_path: Path,
) -> None:
    writer = RecordingWriter(tmp_path / "run.mcap", about(), max_bytes=1)
    for number in range(3):
        fill(writer, range(number, number + 1))
        writer.flush()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["run.mcap", "run_001.mcap", "run_002.mcap"]


def test_a_file_that_grows_meanwhile_is_read_as_long_as_it_was_and_is_not_finished(
    tmp_path: Path,
) -> None:
    writer = RecordingWriter(tmp_path / "run.mcap", about())
    fill(writer, range(3))
    writer.flush()
    (recording,) = open_recordings([tmp_path])
    fill(writer, range(3, 6))
    writer.flush()
    assert numbers_in(list(recording.entries())) == [0, 1, 2]
    (told,) = recording.damage
    assert "it was not finished" in told


def test_a_missing_file_of_several_is_reported(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "run.mcap", about(), max_bytes=1)
    for number in range(3):
        fill(writer, range(number, number + 1))
        writer.flush()
    (recording,) = open_recordings([tmp_path / "run_002.mcap", tmp_path / "run.mcap"])
    assert numbers_in(list(recording.entries())) == [0, 2]
    assert recording.damage == [
        f"{tmp_path}/run_002.mcap: part 1 of the recording, which comes before it, is not here"
    ]


def test_a_file_in_which_nothing_is_yet_is_told_and_the_others_are_read(
    sound: bytes, tmp_path: Path
) -> None:
    (tmp_path / "run.mcap").write_bytes(sound)
    (tmp_path / "run_001.mcap").touch()
    (recording,) = open_recordings([tmp_path, *tmp_path.iterdir()])
    assert len(list(recording.entries())) == CHUNKS * PER_CHUNK
    (told,) = recording.damage
    assert told.startswith(f"{tmp_path / 'run_001.mcap'}: empty")


@pytest.mark.parametrize("alone", ["run.mcap", ""])
def test_nothing_but_an_empty_file_is_refused(tmp_path: Path, alone: str) -> None:
    (tmp_path / "run.mcap").touch()
    with pytest.raises(Unreadable, match=r"run\.mcap: empty"):
        open_recordings([tmp_path / alone])


def test_recordings_made_apart_stay_apart_in_the_order_of_their_making(tmp_path: Path) -> None:
    for session, started_ns in (("later", START_NS + 10**9), ("earlier", START_NS)):
        writer = RecordingWriter(tmp_path / f"{session}.mcap", about(session, started_ns))
        fill(writer, range(2))
        writer.close()
    recordings = open_recordings([tmp_path, tmp_path / "later.mcap"])
    assert [recording.about.session for recording in recordings] == ["earlier", "later"]
    assert [len(list(recording.entries())) for recording in recordings] == [2, 2]


def test_a_file_that_exists_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"precious")
    writer = RecordingWriter(path, about())
    with pytest.raises(FileExistsError):
        fill(writer, range(1))
    assert path.read_bytes() == b"precious"


def test_later_parts_of_another_recording_are_told_at_once(tmp_path: Path) -> None:
    (tmp_path / "run[1]_002.mcap").write_bytes(b"precious")
    writer = RecordingWriter(tmp_path / "run[1].mcap", about(), max_bytes=1)
    with pytest.raises(FileExistsError, match=r"run\[1\]_002\.mcap"):
        writer.open()
    assert not (tmp_path / "run[1].mcap").exists()


def test_a_slow_medium_holds_up_no_new_file_and_its_error_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = threading.Event()

    def sync(_: int) -> None:
        slow.wait(20.0)
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fdatasync", sync)
    writer = RecordingWriter(tmp_path / "run.mcap", about(), max_bytes=1)
    for number in range(3):
        fill(writer, range(number, number + 1))
        writer.flush()
    assert not slow.is_set()
    slow.set()
    with pytest.raises(OSError, match=r"Input/output error: '.*/run\.mcap'"):
        writer.close()
    assert writer.lost == 0
    (recording,) = open_recordings([tmp_path])
    assert numbers_in(list(recording.entries())) == [0, 1, 2]


def test_an_error_that_the_system_tells_once_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = iter([OSError(errno.EIO, os.strerror(errno.EIO))])

    def sync(_: int) -> None:
        for error in errors:
            raise error

    monkeypatch.setattr(os, "fdatasync", sync)
    writer = RecordingWriter(tmp_path / "run.mcap", about())
    fill(writer, range(3))
    with pytest.raises(OSError, match=r"Input/output error: '.*/run\.mcap'"):
        writer.close()


def test_recording_ends_with_a_whole_file_before_the_disk_is_full(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path, about())
    fill(writer, range(5))
    writer.reserve_bytes = 2**62
    with pytest.raises(OSError, match="are left to the robot's other programs"):
        writer.flush()
    with pytest.raises(OSError, match="are left to the robot's other programs"):
        fill(writer, range(1))
    (recording,) = open_recordings([tmp_path])
    assert numbers_in(list(recording.entries())) == list(range(5))
    assert recording.damage == []


def test_after_a_file_was_given_up_the_next_message_opens_another(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path, about())
    fill(writer, range(5))
    writer.flush()
    fill(writer, range(5, 6))
    writer.abandon()
    fill(writer, range(6, 10))
    writer.close()
    assert (writer.messages, writer.lost) == (10, 1)
    (recording,) = open_recordings([tmp_path])
    assert numbers_in(list(recording.entries())) == [0, 1, 2, 3, 4, 6, 7, 8, 9]
    assert len(recording.damage) == 1
    assert "it was not finished" in recording.damage[0]


def foreign_mcap(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        writer.finish()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda path: None, "No such file"),
        (lambda path: path.mkdir(), "no .mcap file in it"),
        (lambda path: path.write_bytes(b""), "empty"),
        (lambda path: path.write_bytes(b"SQLite format 3\0 and so on"), "not an MCAP file"),
        (foreign_mcap, "no recording of wackel"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(
    tmp_path: Path, make: Callable[[Path], None], reason: str
) -> None:
    path = tmp_path / "thing"
    make(path)
    with pytest.raises(Unreadable, match=reason) as refusal:
        open_recordings([path])
    assert str(refusal.value).startswith(str(path))
    assert "\n" not in str(refusal.value)


def test_what_the_system_does_not_let_see_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 256)  # for root no directory is out of bounds
    with pytest.raises(Unreadable, match=f"^{path}: File name too long$"):
        open_recordings([path])


def test_a_file_cut_at_any_byte_gives_all_its_whole_chunks_and_tells_of_the_rest(
    sound: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    before = 0
    for length in range(len(sound)):
        path.write_bytes(sound[:length])
        try:
            file = RecordingFile(path)
        except Unreadable:
            assert before == 0
            continue
        found = numbers_in(list(file.entries()))
        assert found == list(range(len(found)))
        assert len(found) % PER_CHUNK == 0
        assert len(found) >= before
        assert file.damage or length >= len(sound) - len(MCAP0_MAGIC)
        before = len(found)
    assert before == CHUNKS * PER_CHUNK


@settings(max_examples=300, deadline=None)
@given(
    hits=st.lists(st.tuples(st.floats(0, 0.9999), st.binary(min_size=1, max_size=12)), max_size=4)
)
def test_a_damaged_file_gives_only_messages_that_were_recorded_and_tells_of_the_rest(
    sound: bytes, tmp_path_factory: pytest.TempPathFactory, hits: list[tuple[float, bytes]]
) -> None:
    harmed = bytearray(sound)
    for place, bytes_ in hits:
        at = int(place * len(harmed))
        harmed[at : at + len(bytes_)] = bytes_
    path = tmp_path_factory.getbasetemp() / "harmed.mcap"
    path.write_bytes(harmed)
    recorded = {wire.encode(state(number)) for number in range(CHUNKS * PER_CHUNK)}
    try:
        file = RecordingFile(path)
    except Unreadable:
        return
    found = [entry.payload for entry in file.entries()]
    assert set(found) <= recorded
    if len(found) < len(recorded):
        assert file.damage


def test_a_head_that_names_another_robot_than_the_keys_is_told(
    sound: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "harmed.mcap"
    path.write_bytes(sound.replace(b"testbot", b"tes\0bot", 1))
    file = RecordingFile(path)
    assert list(file.entries()) == []
    (told,) = file.damage
    assert "of robot 'tes\\x00bot', the key 'wackel/testbot/bus/main/state' of another" in told


@settings(max_examples=200, deadline=None)
@given(tail=st.binary(max_size=400))
def test_any_bytes_behind_a_sound_head_are_read_without_a_crash(
    sound: bytes, tmp_path_factory: pytest.TempPathFactory, tail: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "tail.mcap"
    path.write_bytes(sound[:300] + tail)
    try:
        list(RecordingFile(path).entries())
    except Unreadable as refusal:
        assert "\n" not in str(refusal)
