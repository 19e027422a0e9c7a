"""One instruction that the master sends, and what for."""

from dataclasses import dataclass
from enum import Enum, auto

from wackel_gateway.roster import Block
from wackel_protocols.dynamixel2 import packet
from wackel_schemas.bus import Purpose


class Stage(Enum):
    """What a job is for, which decides what follows from its outcome."""

    COMMAND = auto()
    CYCLE = auto()
    PLAIN = auto()
    REST = auto()
    DEVICE = auto()
    PING = auto()
    SLOW = auto()


@dataclass(frozen=True, slots=True)
class Job:
    """One instruction to send.

    Attributes:
        stage: What it is for.
        purpose: How it is published.
        instruction: Its bytes.
        ids: Servos that it asks.
        block: What it reads; absent if nothing.
    """

    stage: Stage
    purpose: Purpose
    instruction: bytes
    ids: tuple[int, ...] = ()
    block: Block | None = None

    @property
    def asks_again(self) -> bool:
        """Whether others did not answer just before, so that it asks the rest of them."""
        return self.stage in (Stage.PLAIN, Stage.REST)

    @property
    def is_fast(self) -> bool:
        """Whether it is a Fast Sync Read."""
        return self.instruction[packet.PREFIX_BYTES] == packet.Instruction.FAST_SYNC_READ


def read_together(stage: Stage, block: Block, ids: tuple[int, ...], *, fast: bool) -> Job:
    """A sync read of the cycle; ``fast`` is for two or more."""
    build = packet.fast_sync_read if fast and len(ids) > 1 else packet.sync_read
    return Job(stage, "cycle", build(ids, block.address, block.length), ids, block)


def read_device(device_id: int, block: Block) -> Job:
    """A device that is no servo, in every cycle."""
    instruction = packet.read(device_id, block.address, block.length)
    return Job(Stage.DEVICE, "cycle", instruction, (device_id,), block)


def read_alone(servo_id: int, block: Block) -> Job:
    """Registers of one servo, between cycles."""
    instruction = packet.read(servo_id, block.address, block.length)
    return Job(Stage.SLOW, "background", instruction, (servo_id,), block)


def ping(servo_id: int) -> Job:
    """Is a servo there, and what is it?"""
    return Job(Stage.PING, "ping", packet.ping(servo_id), (servo_id,))
