"""Two links through one rendezvous."""

from collections.abc import Iterator

import pytest

from tests.conftest import Rendezvous
from wackel_node.link import Link


@pytest.fixture
def sender(rendezvous: Rendezvous) -> Iterator[Link]:
    with Link(rendezvous.config) as link:
        yield link


@pytest.fixture
def reader(rendezvous: Rendezvous) -> Iterator[Link]:
    with Link(rendezvous.config) as link:
        yield link
