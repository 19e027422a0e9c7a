"""A port on a pseudo-terminal whose other side does not read."""

import os
from pathlib import Path

import pytest

from tests.gateway.conftest import stuff
from wackel_gateway.port import Port, PortLost
from wackel_node.config import BusConfig


def test_a_port_that_takes_no_bytes_is_not_there_until_it_does(
    wire: int, bus_config: BusConfig
) -> None:
    held = stuff(Path(bus_config.port))
    for _ in range(2):  # the first has given it back
        with pytest.raises(PortLost, match="takes no bytes"):
            Port(bus_config.port, 1_000_000)
    while held > 0:
        held -= len(os.read(wire, held))
    with Port(bus_config.port, 1_000_000) as port:
        assert not port.heard
        port.write(b"?")
        os.write(wire, b"!")
        assert port.wait(1000)
        assert (os.read(wire, 1), port.read(), port.heard) == (b"?", b"!", True)
