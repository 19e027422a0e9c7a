"""Odometry and diagnoser of a drive beside each other, as on the robot, but in one process."""

from collections.abc import Iterable, Iterator, Mapping

from wackel_diagnoser.core import Diagnoser
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.core import Odometer
from wackel_schemas.bus import BusState
from wackel_schemas.drive import Exclusions, ImuSample, TwistCommand
from wackel_schemas.message import Message

Said = Iterator[tuple[str, Message]]
"""Messages, each with the service that says it."""


class DriveDiagnosis:
    """Both cores; the odometry obeys what the diagnoser excludes, from its next step on."""

    def __init__(self, drive: DriveConfig, gyros: Mapping[str, GyroConfig]) -> None:
        self._odometer = Odometer(drive, gyros)
        self._diagnoser = Diagnoser(drive, gyros)

    def bus_state(self, bus: str, state: BusState) -> Said:
        """What the servos of a bus said."""
        odometry = self._odometer.bus_state(bus, state)
        yield from self._said(odometry, self._diagnoser.bus_state(bus, state))

    def imu(self, name: str, sample: ImuSample) -> Said:
        """A sample of an inertial sensor."""
        odometry = self._odometer.imu(name, sample)
        yield from self._said(odometry, self._diagnoser.imu(name, sample))

    def command(self, command: TwistCommand) -> None:
        """What the drive is told."""
        self._diagnoser.command(command)

    def _said(self, odometry: Iterable[Message], diagnosis: Iterable[Message]) -> Said:
        for message in odometry:
            yield "odometry", message
        for message in diagnosis:
            if isinstance(message, Exclusions):
                self._odometer.exclusions(message)
            yield "diagnoser", message
