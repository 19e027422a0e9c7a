"""Buses and views of their answers for the tests of the virtual robot."""

from wackel_node.config import BusConfig, ServoConfig
from wackel_protocols.dynamixel2.packet import StatusPacket
from wackel_protocols.dynamixel2.scanner import Kind, scan
from wackel_virtual import VirtualBus

MS = 1_000_000
PRESENT_POSITION = 132
Chunks = list[tuple[int, bytes]]


def chain(
    size: int,
    *,
    baud_rate: int = 1_000_000,
    power: str = "adapter",
    return_delay_us: int | None = 0,
    model: str = "XM430-W210",
) -> BusConfig:
    """Servos 1 … size in cable order."""
    return BusConfig(
        port="unused",
        baud_rate=baud_rate,
        power=power,
        return_delay_us=return_delay_us,
        servos=[ServoConfig(id=i, model=model) for i in range(1, size + 1)],
    )


def bus(size: int, seed: int = 1, **options: object) -> VirtualBus:
    """A bus with a chain as :func:`chain` makes it."""
    return VirtualBus(chain(size, **options), seed)  # type: ignore[arg-type]


def raw(chunks: Chunks) -> bytes:
    """All bytes of an exchange."""
    return b"".join(data for _, data in chunks)


def statuses(chunks: Chunks) -> list[StatusPacket]:
    """The intact answers of an exchange."""
    segments = scan(raw(chunks))
    return [s.packet for s in segments if s.kind is Kind.PACKET]  # type: ignore[misc]


def ids(chunks: Chunks) -> list[int]:
    """Who answered, in order."""
    return [status.id for status in statuses(chunks)]


def ask(on: VirtualBus, instruction: bytes, wait_ms: float = 20.0) -> Chunks:
    """An exchange some time after the last one."""
    return on.exchange(on.now_ns + 5 * MS, instruction, round(wait_ms * MS))


def ask_one(on: VirtualBus, instruction: bytes) -> StatusPacket:
    """The only answer to an instruction."""
    (status,) = statuses(ask(on, instruction))
    return status
