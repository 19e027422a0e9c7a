"""Odometry and diagnoser of a drive for a replay; apart, because they load numpy and filterpy."""

from collections.abc import Iterable, Mapping

from wackel_cli.replayed import Replayed
from wackel_diagnoser.core import Diagnoser
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_odometry.core import Odometer
from wackel_schemas.bus import BusState, BusStatistics
from wackel_schemas.drive import Exclusions, ImuSample, PoseSet, TwistCommand
from wackel_schemas.keys import (
    EXCLUSIONS,
    IMU,
    POSE_SET,
    STATE,
    STATISTICS,
    TWIST_COMMAND,
    chunk_of,
)
from wackel_schemas.message import Message


class _ReplayedDrive(Replayed):
    """One of the two, on the same wheels and gyros."""

    def __init__(self, core: Odometer | Diagnoser) -> None:
        self._core = core

    def take(self, key: str, message: Message) -> Iterable[Message]:
        """What it concludes."""
        core = self._core
        match message:
            case BusState():
                return core.bus_state(chunk_of(STATE, key, "bus"), message)
            case BusStatistics() if isinstance(core, Odometer):
                return core.bus_statistics(chunk_of(STATISTICS, key, "bus"), message)
            case ImuSample():
                return core.imu(chunk_of(IMU, key, "name"), message)
            case Exclusions() if isinstance(core, Odometer):
                core.exclusions(message)
            case PoseSet() if isinstance(core, Odometer):
                core.request(message.request, message.stamp)
            case TwistCommand() if isinstance(core, Diagnoser):
                core.command(message)
        return ()


class ReplayedOdometry(_ReplayedDrive):
    """``wackel odometry``."""

    topics = (STATE, STATISTICS, IMU, EXCLUSIONS, POSE_SET)  # type: ignore[assignment]

    def __init__(self, drive: DriveConfig, gyros: Mapping[str, GyroConfig]) -> None:
        super().__init__(Odometer(drive, gyros))


class ReplayedDiagnoser(_ReplayedDrive):
    """``wackel diagnoser``."""

    topics = (STATE, IMU, TWIST_COMMAND)  # type: ignore[assignment]

    def __init__(self, drive: DriveConfig, gyros: Mapping[str, GyroConfig]) -> None:
        super().__init__(Diagnoser(drive, gyros, lambda: False))
