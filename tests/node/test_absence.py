"""A device that is missing: on a change at once, then again for those who come later."""

from wackel_node.absence import Absence
from wackel_schemas import component


def test_it_is_told_on_a_change_and_repeated_on_request() -> None:
    fault = Absence("adapter_unplugged", component.adapter("main"), "/dev/ttyUSB0")
    assert fault.again(1) is None
    first = fault.lost("it was unplugged", 10)
    assert first is not None
    assert first.message == "The adapter of bus main is not there: it was unplugged."
    assert (first.code, first.status, first.since) == ("adapter_unplugged", "active", 10)
    assert fault.lost("it was unplugged", 11) is None
    other = fault.lost("no permission to open it", 12)
    assert other is not None
    assert "no permission" in other.message
    assert other.since == 10
    again = fault.again(13)
    assert again is not None
    assert again.repeated
    healed = fault.back(14)
    assert healed is not None
    assert (healed.status, healed.since) == ("healed", 10)
    assert fault.back(15) is None
    assert fault.again(16) is None
