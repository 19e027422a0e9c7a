"""Odometry and diagnoser of a drive for a replay; apart, because they load numpy and filterpy."""

from collections.abc import Iterable, Mapping

from wackel_cli.replayed import Replayed
from wackel_diagnoser.core import Diagnoser
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.core import Odometer
from wackel_schemas.bus import BusState
from wackel_schemas.drive import Exclusions, ImuSample, TwistCommand
from wackel_schemas.keys import EXCLUSIONS, IMU, STATE, TWIST_COMMAND, chunk_of
from wackel_schemas.message import Message


class ReplayedOdometry(Replayed):
    """``wackel odometry``."""

    topics = (STATE, IMU, EXCLUSIONS)  # type: ignore[assignment]

    def __init__(self, drive: DriveConfig, gyros: Mapping[str, GyroConfig]) -> None:
        self._core = Odometer(drive, gyros)

    def take(self, key: str, message: Message) -> Iterable[Message]:
        """What it concludes."""
        match message:
            case BusState():
                return self._core.bus_state(chunk_of(STATE, key, "bus"), message)
            case ImuSample():
                return self._core.imu(chunk_of(IMU, key, "name"), message)
            case Exclusions():
                self._core.exclusions(message)
        return ()


class ReplayedDiagnoser(Replayed):
    """``wackel diagnoser``."""

    topics = (STATE, IMU, TWIST_COMMAND)  # type: ignore[assignment]

    def __init__(self, drive: DriveConfig, gyros: Mapping[str, GyroConfig]) -> None:
        self._core = Diagnoser(drive, gyros)

    def take(self, key: str, message: Message) -> Iterable[Message]:
        """What it concludes."""
        match message:
            case BusState():
                return self._core.bus_state(chunk_of(STATE, key, "bus"), message)
            case ImuSample():
                return self._core.imu(chunk_of(IMU, key, "name"), message)
            case TwistCommand():
                self._core.command(message)
        return ()
