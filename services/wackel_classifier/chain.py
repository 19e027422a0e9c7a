"""The chain of a bus as the configuration gives it: positions, ids and names of components."""

from wackel_node.config import BusConfig
from wackel_schemas import component


class Chain:
    """Servos in cable order; position 0 is next to the adapter. Cable ``k`` leads to servo ``k``.

    Attributes:
        bus: Name of the bus.
        ids: Servo ids by position.
        position: Positions by id.
        power: Where supply enters.
    """

    def __init__(self, bus: str, config: BusConfig) -> None:
        self.bus = bus
        self.ids = config.ids()
        self.position = {servo_id: place for place, servo_id in enumerate(self.ids)}
        self.power = config.power

    def __len__(self) -> int:
        return len(self.ids)

    def servo(self, position: int) -> str:
        """Path of a servo."""
        return component.servo(self.bus, self.ids[position])

    def cable(self, position: int) -> str:
        """Path of the cable that leads to a servo."""
        before = self.ids[position - 1] if position else None
        return component.cable(self.bus, before, self.ids[position])

    def cables(self) -> list[str]:
        """Paths of all cables, from the adapter outwards."""
        return [self.cable(position) for position in range(len(self))]
