"""What is told of findings as they come, change and go."""

from wackel_diagnoser.reports import Finding, Reports


def finding(*suspects: str, since: int = 1) -> Finding:
    return Finding("gyro_deviates", "gyro/body", "seen", since, suspects=suspects)


def test_a_fault_is_told_as_it_begins_and_as_it_heals() -> None:
    reports = Reports()
    (begun,) = reports.update([finding()], stamp=2)
    assert (begun.status, begun.since, begun.stamp) == ("active", 1, 2)
    assert reports.update([finding()], stamp=3) == []
    (healed,) = reports.update([], stamp=4)
    assert (healed.status, healed.since, healed.stamp) == ("healed", 1, 4)
    assert not reports.any_active


def test_it_is_told_again_if_the_evidence_fits_more_than_it_seemed() -> None:
    reports = Reports()
    reports.update([finding("drive")], stamp=2)
    (again,) = reports.update([finding("wheel/w1/steering", since=3)], stamp=4)
    assert again.suspects == ["wheel/w1/steering", "drive"]
    assert (again.since, again.stamp) == (1, 4)
    assert reports.active() == [again]
    assert reports.update([finding("drive"), finding()], stamp=5) == []
