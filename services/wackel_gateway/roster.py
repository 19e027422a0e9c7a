"""What is known of the servos of a bus: who they are, and where their registers lie."""

from contextlib import suppress
from dataclasses import dataclass

from wackel_node.config import ServoConfig
from wackel_protocols.dynamixel2.control_table import Model, UnknownModel, configured, model


@dataclass(frozen=True)
class Block:
    """Registers that one read fetches together.

    Attributes:
        address: Of the first byte.
        length: Bytes.
    """

    address: int
    length: int

    @classmethod
    def of(cls, servo: Model, *names: str) -> "Block | None":
        """The block from the first to the last of those registers that the model has."""
        found = [servo.registers[name] for name in names if name in servo.registers]
        if not found:
            return None
        first = min(register.address for register in found)
        last = max(register.address + register.length for register in found)
        return cls(first, last - first)


class Member:
    """One servo.

    Attributes:
        id: On the bus.
        configured: The model it should be.
        model: The same until the servo itself says what it is.
        model_number, firmware: As it says; absent until then.
    """

    def __init__(self, config: ServoConfig) -> None:
        self.id = config.id
        self.configured = configured(config.model)
        self.model = self.configured
        self.model_number: int | None = None
        self.firmware: int | None = None

    def identify(self, model_number: int, firmware: int) -> None:
        """Takes over what a ping's answer says.

        A model that is in no table keeps the configured one's registers.
        """
        self.model_number = model_number
        self.firmware = firmware
        with suppress(UnknownModel):
            self.model = model(model_number)

    @property
    def knows_fast_sync_read(self) -> bool:
        """Whether its firmware, once known, answers Fast Sync Read."""
        least = self.model.fast_sync_read_firmware
        return least is not None and self.firmware is not None and self.firmware >= least

    @property
    def cycle_block(self) -> Block | None:
        """What every cycle reads."""
        return Block.of(
            self.model, "present_position", "present_velocity", "present_current", "present_load"
        )


class Roster:
    """The servos of a bus in cable order."""

    def __init__(self, servos: list[ServoConfig]) -> None:
        self.members = {servo.id: Member(servo) for servo in servos}

    def model(self, servo_id: int) -> Model | None:
        """The control table of a servo; absent if the id is not configured."""
        member = self.members.get(servo_id)
        return None if member is None else member.model
