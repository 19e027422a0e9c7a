"""A virtual bus as a serial port: the vendor's SDK and rustypot use it unchanged."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import dynamixel_sdk as sdk
import pytest
import rustypot
import serial

from tests.conftest import wait_until
from tests.virtual.material import chain, ids
from wackel_node.config import ConfigError
from wackel_protocols.dynamixel2 import packet
from wackel_schemas.virtual import Injection
from wackel_virtual import VirtualBus
from wackel_virtual.port import Ports, Terminal, claimed

pytestmark = pytest.mark.process

BAUD_RATE = 1_000_000


@contextmanager
def running(path: Path, size: int = 5) -> Iterator[Ports]:
    with Ports({"main": (VirtualBus(chain(size)), path)}) as ports:
        yield ports


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "bus"


@pytest.fixture
def ports(path: Path) -> Iterator[Ports]:
    with running(path) as opened:
        yield opened


@pytest.fixture
def vendor(ports: Ports, path: Path) -> Iterator[sdk.PortHandler]:
    handler = sdk.PortHandler(str(path))
    assert handler.setBaudRate(BAUD_RATE)
    yield handler
    handler.closePort()


def inject(ports: Ports, kind: str, servo: int | None = None) -> None:
    ports.call(lambda buses: buses["main"].inject(Injection(kind=kind, servo=servo)))


PROTOCOL = sdk.PacketHandler(2.0)
OK = sdk.COMM_SUCCESS


def test_a_wire_that_dies_is_told_to_whoever_calls(path, monkeypatch):
    def break_down(*_):
        raise OverflowError("too large")

    bus = VirtualBus(chain(1))
    monkeypatch.setattr(bus, "transmit", break_down)
    monkeypatch.setattr("threading.excepthook", lambda _: None)  # its traceback is expected
    with Ports({"main": (bus, path)}) as ports:
        os.write(os.open(path, os.O_RDWR | os.O_NOCTTY), b"\xff")

        def is_told() -> bool:
            try:
                ports.call(len)
            except RuntimeError as error:
                return "OverflowError('too large')" in str(error)
            return False

        wait_until(is_told)
    assert not path.is_symlink()


def until_up(vendor, servo):
    wait_until(lambda: PROTOCOL.ping(vendor, servo)[1] == OK, limit_s=5.0)


def test_sdk_ping_and_broadcast_ping(vendor):
    assert PROTOCOL.ping(vendor, 3) == (1030, OK, 0)
    assert PROTOCOL.ping(vendor, 99)[1] == sdk.COMM_RX_TIMEOUT
    found, result = PROTOCOL.broadcastPing(vendor)
    assert result == OK
    assert found == {i: [1030, 50] for i in range(1, 6)}


def test_sdk_reads_and_writes(vendor):
    assert PROTOCOL.write1ByteTxRx(vendor, 1, 65, 1) == (OK, 0)
    assert PROTOCOL.read1ByteTxRx(vendor, 1, 65) == (1, OK, 0)
    assert PROTOCOL.write2ByteTxRx(vendor, 1, 84, 700) == (OK, 0)
    assert PROTOCOL.read2ByteTxRx(vendor, 1, 84) == (700, OK, 0)
    assert PROTOCOL.write4ByteTxRx(vendor, 1, 116, 3000) == (OK, 0)
    assert PROTOCOL.read4ByteTxRx(vendor, 1, 116) == (3000, OK, 0)
    assert PROTOCOL.write1ByteTxRx(vendor, 1, 64, 9) == (OK, 4)  # data range error


def test_sdk_reg_write_and_action(vendor):
    assert PROTOCOL.regWriteTxRx(vendor, 1, 116, 4, [0, 8, 0, 0]) == (OK, 0)
    # To all: the SDK does not wait for an answer to action, so one would collide with the next.
    assert PROTOCOL.action(vendor, packet.BROADCAST_ID) == OK
    assert PROTOCOL.read4ByteTxRx(vendor, 1, 116) == (2048, OK, 0)


def test_sdk_sync_write_and_sync_read_plain_and_fast(vendor):
    writer = sdk.GroupSyncWrite(vendor, PROTOCOL, 116, 4)
    reader = sdk.GroupSyncRead(vendor, PROTOCOL, 116, 4)
    for servo in range(1, 6):
        assert writer.addParam(servo, [servo, 7, 0, 0])
        assert reader.addParam(servo)
    assert writer.txPacket() == OK
    for read in (reader.txRxPacket, reader.fastSyncRead):
        assert read() == OK
        assert [reader.getData(i, 116, 4) for i in range(1, 6)] == [1792 + i for i in range(1, 6)]


def test_sdk_bulk_write_and_bulk_read_plain_and_fast(vendor):
    writer = sdk.GroupBulkWrite(vendor, PROTOCOL)
    assert writer.addParam(1, 116, 4, [1, 7, 0, 0])
    assert writer.addParam(2, 65, 1, [1])
    assert writer.txPacket() == OK
    reader = sdk.GroupBulkRead(vendor, PROTOCOL)
    for servo, address, length in ((1, 116, 4), (2, 65, 1), (3, 0, 2)):
        assert reader.addParam(servo, address, length)
    for read in (reader.txRxPacket, reader.fastBulkRead):
        assert read() == OK
        assert reader.getData(1, 116, 4) == 1793
        assert reader.getData(2, 65, 1) == 1
        assert reader.getData(3, 0, 2) == 1030


def test_sdk_reboot_and_clear(vendor):
    assert PROTOCOL.write1ByteTxRx(vendor, 2, 65, 1) == (OK, 0)
    assert PROTOCOL.reboot(vendor, 2) == (OK, 0)
    assert PROTOCOL.ping(vendor, 2)[1] == sdk.COMM_RX_TIMEOUT
    until_up(vendor, 2)
    assert PROTOCOL.read1ByteTxRx(vendor, 2, 65) == (0, OK, 0)
    assert PROTOCOL.clearMultiTurn(vendor, 2) == (OK, 0)


def test_sdk_factory_reset_and_another_baud_rate(vendor):
    assert PROTOCOL.factoryReset(vendor, 4, 0x01) == (OK, 0)
    assert vendor.setBaudRate(57_600)
    until_up(vendor, 4)
    assert PROTOCOL.ping(vendor, 1)[1] == sdk.COMM_RX_TIMEOUT
    assert PROTOCOL.write1ByteTxRx(vendor, 4, 8, 3) == (OK, 0)
    assert vendor.setBaudRate(BAUD_RATE)
    assert PROTOCOL.ping(vendor, 4) == (1030, OK, 0)


def test_sdk_sees_the_alert_of_an_overloaded_servo(ports, vendor):
    inject(ports, "overload", 3)
    assert PROTOCOL.ping(vendor, 3) == (1030, OK, 128)
    assert PROTOCOL.read1ByteTxRx(vendor, 3, 70) == (32, OK, 128)


def test_rustypot_reads_and_writes(ports, path):
    controller = rustypot.Xl430PyController(str(path), BAUD_RATE, 0.1)
    try:
        assert controller.ping(2)
        controller.sync_write_goal_position([1, 2, 3], [1000, 2000, 3000])
        assert controller.sync_read_goal_position([1, 2, 3]) == [1000, 2000, 3000]
        controller.write_torque_enable(1, True)
        assert controller.read_torque_enable(1) == [True]
        assert len(controller.sync_read_present_position([1, 2, 3, 4, 5])) == 5
        inject(ports, "silent", 4)
        with pytest.raises(RuntimeError):
            controller.sync_read_present_position([1, 2, 3, 4, 5])
        assert len(controller.sync_read_present_position([1, 2, 3])) == 3
        assert controller.reboot(1)
    finally:
        controller.close()


def test_every_baud_rate_of_the_servos_can_be_set(tmp_path):
    terminal = Terminal(tmp_path / "bus")
    try:
        for rate in (57_600, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000):
            with serial.Serial(str(terminal.path), rate):
                assert terminal.baud_rate() == rate
    finally:
        terminal.unplug()


def test_an_unplugged_adapter_gives_its_client_an_error_and_comes_back_at_the_same_path(
    ports, path
):
    client = serial.Serial(str(path), BAUD_RATE, timeout=5)
    inject(ports, "unplugged")
    wait_until(lambda: not path.is_symlink())
    with pytest.raises((serial.SerialException, OSError)):
        while True:
            client.write(packet.ping(1))
            if not client.read(1):
                raise OSError(errno.EIO, "end of file")
    client.close()
    ports.call(lambda buses: buses["main"].heal())
    wait_until(path.exists)
    with serial.Serial(str(path), BAUD_RATE, timeout=5) as again:
        again.write(packet.ping(1))
        assert packet.decode(again.read(14)).id == 1


def test_a_client_may_come_and_go(ports, path):
    for _ in range(5):
        with serial.Serial(str(path), BAUD_RATE, timeout=5) as client:
            client.write(packet.ping(5))
            assert packet.decode(client.read(14)).id == 5


def test_a_client_that_never_reads_stalls_nothing(ports, path):
    with serial.Serial(str(path), BAUD_RATE) as deaf:
        inject(ports, "permanent_jammer")
        wait_until(lambda: deaf.in_waiting >= 4095)  # the terminal's buffer is full
        deaf.write(packet.ping(1))
    ports.call(lambda buses: buses["main"].heal())
    assert ports.call(lambda buses: buses["main"].active()) == []


def test_answers_in_real_time_are_those_of_the_pure_bus(ports, path):
    request = packet.sync_read(range(1, 6), 0, 8)
    pure = VirtualBus(chain(5))
    expected = b"".join(data for _, data in pure.exchange(0, request, 20_000_000))
    with serial.Serial(str(path), BAUD_RATE, timeout=5) as client:
        client.write(request)
        assert client.read(len(expected)) == expected
    assert ids([(0, expected)]) == [1, 2, 3, 4, 5]


def test_nothing_is_left_behind(path):
    def open_files():
        return len(list(Path("/proc/self/fd").iterdir()))

    before = open_files()
    with running(path):
        assert path.is_symlink()
    assert not os.path.lexists(path)
    assert open_files() == before


def test_a_link_that_a_killed_process_left_is_taken_over(path):
    path.symlink_to("/dev/pts/4096")
    with running(path):
        assert path.exists()


def test_a_path_that_is_something_else_is_left_alone(path):
    path.write_text("precious")
    with pytest.raises(ConfigError, match="exists and is no virtual port"), running(path):
        pass
    assert path.read_text() == "precious"


def test_a_path_that_cannot_be_is_said_so(tmp_path):
    with (
        pytest.raises(ConfigError, match="cannot be made: No such file"),
        running(tmp_path / "nowhere" / "bus"),
    ):
        pass


def test_an_error_of_a_call_comes_back_to_its_caller(ports):
    with pytest.raises(KeyError, match="absent"):
        ports.call(lambda buses: buses["absent"])
    assert ports.call(list) == ["main"]


def test_a_port_belongs_to_one_virtual_robot_at_a_time(path):
    with (
        claimed([path]),
        pytest.raises(ConfigError, match="another virtual robot runs there"),
        claimed([path.with_name("other"), path]),
    ):
        pass
    with claimed([path.with_name("other"), path]):
        pass


def test_a_port_that_is_something_else_is_not_claimed(path):
    path.write_text("precious")
    with pytest.raises(ConfigError, match="exists and is no virtual port"), claimed([path]):
        pass


def test_a_port_may_have_a_long_path(tmp_path: Path):
    directory = tmp_path / ("long" * 40)
    directory.mkdir()
    with claimed([directory / "bus"]), running(directory / "bus"):
        assert (directory / "bus").exists()
