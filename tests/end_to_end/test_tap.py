"""A gateway that only listens, beside the vendor's library as the master of the bus."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from tests import robot as robots
from tests.conftest import wait_until
from tests.end_to_end.command import LIMIT_S, read_until, started
from tests.end_to_end.test_proxy_control import controlling
from tests.gateway.conftest import IDS
from tests.gateway.test_proxy_process import Control
from wackel_schemas import keys
from wackel_schemas.bus import BusState, Transaction

pytestmark = pytest.mark.process


def test_a_tap_decodes_the_masters_traffic_and_the_classifier_names_a_break(
    tmp_path: Path,
) -> None:
    wire = robots.chain(tmp_path, len(IDS), return_delay_us=0)
    tap = msgspec.structs.replace(wire.buses["main"], mode="tap", port=str(tmp_path / "tap"))
    tapped = msgspec.structs.replace(wire, buses={"main": tap})
    virtual = ("virtual", "--config", robots.write(wire, tmp_path, "wire"))
    with (
        robots.running(tapped, tmp_path, virtual=False) as robot,
        started(*virtual, "--tap", f"main={tap.port}") as bus,
    ):
        read_until(bus, "ready")
        transactions: list[Transaction] = []
        states: list[BusState] = []
        robot.link.subscribe(keys.TRANSACTION, lambda _, told: transactions.append(told))
        robot.link.subscribe(keys.STATE, lambda _, told: states.append(told))
        with Control(wire.buses["main"].port) as control:

            def control_until(condition: Callable[[], bool]) -> None:
                wait_until(condition, LIMIT_S, lambda: controlling(robot, control))

            control_until(lambda: robot.status("gateway/main") == "ready" and bool(transactions))
            assert {told.purpose for told in transactions} == {"observed"}
            control_until(lambda: whole(transactions[-1]))
            control_until(
                lambda: bool(states) and [servo.id for servo in states[-1].servos] == list(IDS)
            )
            robot.inject("break", 4)
            control_until(lambda: robot.confirmed("cable_break", "bus/main/cable/3-4"))
            robot.heal()
            control_until(lambda: not robot.confirmed("cable_break", "bus/main/cable/3-4"))


def whole(transaction: Transaction) -> bool:
    """All servos have answered."""
    return [answer.id for answer in transaction.response_times] == list(IDS)
