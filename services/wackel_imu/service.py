"""One gyro as a process: read, publish; wait for it where it is not there."""

from pathlib import Path

from wackel_imu.device import Device, DeviceLost
from wackel_node.absence import Absence
from wackel_node.config import RobotConfig
from wackel_node.log import logger
from wackel_node.node import Node
from wackel_schemas import component, keys
from wackel_schemas.fault import FaultReport

RETRY_S = 0.5
"""A driver that is loaded or a plug that is put in shows that soon."""
REPEAT_S = 1.0
"""An active fault is told again so often, for those who came later."""
_TURN_S = 0.1
"""A signal is noticed within this time."""


def run(config: RobotConfig, name: str, sysfs: Path, nodes: Path) -> None:
    """Runs the service until a signal ends it."""
    gyro = config.gyros[name]
    with Node("imu", name, config) as node:
        samples = node.publisher(keys.IMU, name=name)
        faults = node.publisher(keys.FAULT, source=f"imu-{name}")
        absence = Absence("gyro_absent", component.gyro(name), gyro.device or "")

        def report(change: FaultReport | None) -> None:
            if change is not None:
                if not change.repeated:
                    logger.warning("%s: %s", change.status, change.message)
                faults.put(change)

        node.every(REPEAT_S, lambda: report(absence.again(node.clock.now_ns())))
        node.await_links()
        node.ready()
        while not node.stopping:
            try:
                with Device(gyro, node.clock.now_ns, sysfs, nodes) as device:
                    logger.info("reading %s, stamped by the clock %s", gyro.device, device.clock)
                    report(absence.back(node.clock.now_ns()))
                    while not node.stopping:
                        for sample in device.read(_TURN_S):
                            samples.put(sample)
                        node.pump()
            except DeviceLost as lost:
                report(absence.lost(str(lost), node.clock.now_ns()))
                node.pump(RETRY_S)
