"""``wackel demo``: what it shows. That the first two are named is tested end to end."""

from wackel_cli.demo import EPISODES
from wackel_schemas.fault_codes import FAULT_CODES
from wackel_virtual.drive_faults import DRIVE_KINDS


def test_faults_of_the_drive_and_of_the_bus_take_turns() -> None:
    of_drive = [episode.injection.kind in DRIVE_KINDS for episode in EPISODES]
    assert of_drive == [True, False] * (len(EPISODES) // 2)


def test_every_fault_has_names_that_there_are() -> None:
    assert {code for episode in EPISODES for code in episode.codes} <= set(FAULT_CODES)
