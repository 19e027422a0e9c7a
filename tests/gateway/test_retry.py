"""A port that opens and is lost at once is told once, and tried less and less often."""

from collections.abc import Callable
from typing import cast

import pytest

from wackel_gateway import retry
from wackel_gateway.port import Port, PortLost
from wackel_gateway.reporter import Reporter
from wackel_node.config import BusConfig
from wackel_node.node import Node


class World:
    """Node and reporter at once; time passes only where somebody waits."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.stopping = False
        self.told: list[str] = []
        self.look: Callable[[], None]

    def every(self, period_s: float, handler: Callable[[], None]) -> None:
        self.look = handler

    def pump(self, timeout_s: float) -> None:
        self.now_ns += round(timeout_s * 1e9)
        self.look()

    def connected(self, baud_rate: int, latency_timer_ms: int | None) -> None:
        self.told.append("connected")

    def lost(self, reason: str) -> None:
        self.told.append(reason)


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    world = World()
    monkeypatch.setattr(retry, "monotonic_ns", lambda: world.now_ns)
    return world


def test_a_port_that_opens_without_working_is_not_told_as_back(
    wire: int, bus_config: BusConfig, world: World
) -> None:
    tries_s: list[float] = []

    def use(_: Port) -> None:
        tries_s.append(world.now_ns / 1e9)
        if tries_s[-1] < 5.0:
            raise PortLost("wedged")
        world.pump(0.5)
        assert "connected" not in world.told[1:]
        world.pump(0.5)
        world.stopping = True

    retry.keep_open(cast(Node, world), bus_config, cast(Reporter, world), use)
    assert tries_s == [0.0, 0.05, 0.15, 0.35, 0.75, 1.55, 2.55, 3.55, 4.55, 5.55]
    assert world.told == ["connected", *["wedged"] * 9, "connected"]


def test_what_says_something_is_back_at_once(
    wire: int, bus_config: BusConfig, world: World
) -> None:
    uses = 0

    def use(port: Port) -> None:
        nonlocal uses
        uses += 1
        if uses == 1:
            raise PortLost("unplugged")
        port.heard = True
        world.pump(0.0)
        world.stopping = True

    retry.keep_open(cast(Node, world), bus_config, cast(Reporter, world), use)
    assert world.told == ["connected", "unplugged", "connected"]
