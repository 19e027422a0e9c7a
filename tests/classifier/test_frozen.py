"""When constant values are a fault: the module by itself."""

import pytest

from tests.classifier.rig import chain
from wackel_classifier.alerts import Alerts
from wackel_classifier.chain import Chain
from wackel_classifier.frozen import Frozen
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.control_table import model
from wackel_protocols.dynamixel2.tables import Series

MS = 1_000_000
GOAL_POSITION = 116  # of the X series


class Joint:
    """One servo that gets a new goal every 50 ms."""

    def __init__(self) -> None:
        bus = Chain("main", chain(1))
        self.frozen = Frozen(bus, [model("XM430-W210")])
        self.alerts = Alerts(bus, [Series.X])
        self.now_ns = 0

    def move(self, times: int, *, follows: bool) -> list[str]:
        """What is found after so many goals."""
        for _ in range(times):
            self.now_ns += 50 * MS
            goal = self.now_ns // MS
            data = goal.to_bytes(4, "little")
            self.frozen.command(packet.sync_write(GOAL_POSITION, 4, {1: data}))
            self.frozen.values(0, data if follows else b"same", None, self.now_ns, self.now_ns)
        return [finding.code for finding in self.frozen.findings(self.alerts)]


def test_a_servo_that_no_longer_follows_its_goals_is_found() -> None:
    joint = Joint()
    assert joint.move(10, follows=True) == []
    assert joint.move(20, follows=False) == ["frozen_values"]


@pytest.mark.parametrize(("torque", "found"), [(True, ["frozen_values"]), (False, []), (None, [])])
def test_after_it_was_out_of_reach_it_is_held_to_its_goals_once_its_torque_is_known_to_be_on(
    torque: bool | None, found: list[str]
) -> None:
    joint = Joint()
    joint.move(10, follows=True)
    joint.frozen.gone(0)
    if torque is not None:
        joint.frozen.torque(0, torque)
    assert joint.move(20, follows=False) == found
