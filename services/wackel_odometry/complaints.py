"""Complaints about inputs: who sends what cannot be."""

from collections.abc import Iterable

from wackel_drive.alignment import Refusal
from wackel_odometry.reports import Complaint

FORGIVEN = 10
"""Late or repeated samples at once, and as many each MEMORY_NS, that a busy computer may cause."""
MEMORY_NS = 1_000_000_000

_REASONS: dict[Refusal, str] = {
    "implausible": "values that are no numbers, or beyond all measure",
    "late": "stamps of the past",
    "ahead": "stamps of the future",
    "repeated": "the same stamp twice",
    "flood": "more samples than it can have taken",
}


class InputWatch:
    """Counts refused samples by source and reason."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, Refusal], tuple[int, int, float]] = {}
        """Last stamp; how many in a row, none further apart than is remembered; and how many of
        them are left after what is forgiven with time, up to twice what is forgiven at once."""

    def refuse(self, refused: Iterable[tuple[str, Refusal]], now: int) -> None:
        """Samples that were not taken at a time."""
        for key in refused:
            last, count, level = self._seen.get(key, (now, 0, 0.0))
            since = abs(now - last) / MEMORY_NS
            left = max(level - since * FORGIVEN, 0.0)
            self._seen[key] = now, 1 + (count if since <= 1 else 0), min(left + 1, 2 * FORGIVEN)

    def complaints(self, now: int) -> dict[str, list[Complaint]]:
        """What is wrong with each source that was ever refused; an empty list: no longer anything.

        One sample that cannot be is enough; of the others, more than a busy computer causes.
        """
        found: dict[str, list[Complaint]] = {source: [] for source, _ in self._seen}
        for (source, reason), (last, count, level) in self._seen.items():
            recent = abs(now - last) <= MEMORY_NS
            if recent and (reason == "implausible" or level > FORGIVEN):
                complaint = _complaint(reason, count)
                if all(each.code != complaint.code for each in found[source]):
                    found[source].append(complaint)
        return found


def _complaint(reason: Refusal, count: int) -> Complaint:
    values: dict[str, float | int | str] = {"samples": count}
    if reason == "uncertain":
        # Its sender is not to blame, for it said itself that the answer was late.
        return Complaint("late_answers", f"{count} samples of a time that is not known", values)
    words = _REASONS[reason]
    return Complaint("bad_input", f"{count} samples with {words}", values, {"reason": words})
