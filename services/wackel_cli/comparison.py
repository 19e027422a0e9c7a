"""Live reports against replayed ones: which are missing, and which fields differ. No I/O."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from difflib import SequenceMatcher
from typing import Any

import msgspec

from wackel_schemas.fault import FaultReport
from wackel_schemas.message import Record

# What a publisher adds to a report; not part of what was concluded.
_OF_THE_PUBLISHER = ("boot", "seq", "repeated")


class Difference(Record, kw_only=True):
    """One difference.

    Attributes:
        report: Which: ``<number on its part> <code> <component> <status>``.
        path: Of the field, ``evidence.values.failure_rate``; empty: the whole report.
        live, replayed: The values; ``None`` where there is none.
    """

    report: str
    path: str
    live: Any = None
    replayed: Any = None

    def __str__(self) -> str:
        if not self.path:
            return f"{self.report}: only {'live' if self.replayed is None else 'replayed'}"
        return f"{self.report}: {self.path}: live {self.live!r}, replayed {self.replayed!r}"


def differences(live: Iterable[FaultReport], replayed: Iterable[FaultReport]) -> list[Difference]:
    """Compares the reports of one source, each bus, wheel or sensor by itself.

    Only within one of them is there an order.
    """
    found: list[Difference] = []
    lives, replays = _by_part(live), _by_part(replayed)
    for part in sorted(lives.keys() | replays.keys()):
        found += _compare(lives[part], replays[part])
    return found


def _compare(live: list[FaultReport], replayed: list[FaultReport]) -> Iterator[Difference]:
    matcher = SequenceMatcher(None, [*map(_name, live)], [*map(_name, replayed)], autojunk=False)
    for kind, a, a_end, b, b_end in matcher.get_opcodes():
        if kind == "equal":
            for number, (one, other) in enumerate(
                zip(live[a:a_end], replayed[b:b_end], strict=True), a + 1
            ):
                yield from _fields(f"{number} {_name(one)}", _plain(one), _plain(other))
            continue
        for number, report in enumerate(live[a:a_end], a + 1):
            yield Difference(report=f"{number} {_name(report)}", path="", live=report)
        for number, report in enumerate(replayed[b:b_end], b + 1):
            yield Difference(report=f"{number} {_name(report)}", path="", replayed=report)


def _fields(report: str, live: Any, replayed: Any, path: str = "") -> Iterator[Difference]:
    match live, replayed:
        case dict(), dict():
            pairs = [(key, live.get(key), replayed.get(key)) for key in {**live, **replayed}]
        case list(), list() if len(live) == len(replayed):
            pairs = [(str(n), *pair) for n, pair in enumerate(zip(live, replayed, strict=True))]
        case _:
            if live != replayed:
                yield Difference(report=report, path=path, live=live, replayed=replayed)
            return
    for key, one, other in pairs:
        yield from _fields(report, one, other, f"{path}.{key}" if path else str(key))


def _by_part(reports: Iterable[FaultReport]) -> defaultdict[str, list[FaultReport]]:
    parts: defaultdict[str, list[FaultReport]] = defaultdict(list)
    for report in reports:
        parts["/".join(report.component.split("/")[:2])].append(report)
    return parts


def _name(report: FaultReport) -> str:
    return f"{report.code} {report.component} {report.status}"


def _plain(report: FaultReport) -> dict[str, Any]:
    fields: dict[str, Any] = msgspec.to_builtins(report)
    return {key: value for key, value in fields.items() if key not in _OF_THE_PUBLISHER}
