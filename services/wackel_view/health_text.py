"""Health as text and as lines of a log."""

import msgspec
from foxglove.messages import Log, LogLevel

from wackel_schemas.component import in_words
from wackel_schemas.health import FaultRecord, Health
from wackel_view.drawing import timestamp

_LEVELS = {"info": LogLevel.Info, "warning": LogLevel.Warning, "fault": LogLevel.Error}
_SHOWN = ("confirmed", "unknown", "pending")


def text(health: Health) -> str:
    """Several lines: the summary, each fault with its remedy, and which services are not ready."""
    lines = [f"{health.level.upper()}: {health.summary}"]
    for fault in health.faults:
        if fault.status in _SHOWN:
            why = f" (follows from {fault.inhibited_by})" if fault.inhibited_by else ""
            lines += ["", f"[{fault.status}] {fault.message}{why}", f"  {fault.remedy}"]
    silent = [f"{each.name} {each.status}" for each in health.services if each.status != "ready"]
    if silent:
        lines += ["", f"Services: {', '.join(silent)}"]
    able = [name for name, can in health.capabilities.items() if can]
    unable = [name for name, can in health.capabilities.items() if not can]
    lines += ["", f"The robot {', '.join(able) or 'can nothing for certain'}"] if able else []
    lines += [f"but not {', '.join(unable)}"] if unable else []
    return "\n".join(lines)


def as_json(health: Health) -> bytes:
    """What panels show: level, one line, all lines, and the faults."""
    shown = {
        "level": health.level,
        "summary": health.summary,
        "text": text(health),
        "capabilities": health.capabilities,
        "faults": [
            {
                "code": fault.code,
                "component": fault.component,
                "status": fault.status,
                "severity": fault.severity,
                "message": fault.message,
                "remedy": fault.remedy,
            }
            for fault in health.faults
        ],
        "services": {each.name: each.status for each in health.services},
    }
    return msgspec.json.encode(shown)


def changes(before: Health | None, health: Health) -> list[Log]:
    """A line for each fault and service whose status has changed.

    Raises:
        Rejected: The stamp is none.
    """
    stamp = timestamp(health.stamp)
    faults = {_key(fault): fault.status for fault in before.faults} if before is not None else {}
    services = {each.name: each.status for each in before.services} if before is not None else {}
    lines = [
        Log(
            timestamp=stamp,
            level=LogLevel.Info if fault.status == "healed" else _LEVELS[fault.severity],
            name=fault.source,
            message=f"{fault.status}: {fault.message} {fault.remedy}",
        )
        for fault in health.faults
        if faults.get(_key(fault)) != fault.status
    ]
    lines += [
        Log(
            timestamp=stamp,
            level=LogLevel.Info if each.status in ("ready", "starting") else LogLevel.Warning,
            name=each.name,
            message=f"{in_words(f'service/{each.name}')} is {each.status} {each.reason}".strip(),
        )
        for each in health.services
        if services.get(each.name) != each.status
    ]
    return lines


def _key(fault: FaultRecord) -> tuple[str, str, str]:
    return fault.code, fault.component, fault.source
