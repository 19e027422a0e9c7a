"""Health: all faults of all sources merged, and who is alive."""

from typing import Literal

from wackel_schemas.fault import Evidence
from wackel_schemas.message import Message, Record

FaultStatus = Literal["pending", "confirmed", "healed", "unknown"]
Level = Literal["ok", "warning", "fault", "unknown"]


class Heartbeat(Message, kw_only=True):
    """A sign of life of a service, once a period (``alive/<service>/<instance>``).

    Attributes:
        state: ``starting``, ``ready``, ``stopping`` or ``crashed``.
        reason: Why, where the state needs one (a crash: exception and place, or, where the
            program is not to blame, the sentence that its command prints).
        period_s: When the next one is due; late after 2.5 of them.
        pid: Process id.
        received: Messages received since boot.
        lost: Messages of others that never arrived (jumps in ``seq``) since boot.
        overrun: Messages that arrived and were dropped here because the service was busy.
        rejected: Messages and requests that were not understood.
        rejection: Key and reason of the latest of them.
    """

    state: Literal["starting", "ready", "stopping", "crashed"]
    period_s: float
    pid: int
    reason: str = ""
    received: int = 0
    lost: int = 0
    overrun: int = 0
    rejected: int = 0
    rejection: str = ""


class FaultRecord(Record, kw_only=True):
    """A fault as health keeps it; words as in AUTOSAR's Diagnostic Event Manager.

    Attributes:
        code, component, message, remedy, confidence, suspects, evidence: As in the last report.
        source: Who reports it.
        service: ``<service>/<instance>`` behind the source; empty if it is not known.
        severity: From the table of codes.
        status: ``pending`` (seen, not yet debounced), ``confirmed``, ``healed`` (kept), or
            ``unknown`` (its source is silent).
        inhibited_by: Component/code of the fault that this one follows from; empty if none.
        acknowledged: A person has seen it.
        occurrences: How often it became confirmed.
        first: UTC ns of the first evidence; of one that has come back, since then.
        last: UTC ns at which its source last named it, or said that it is gone.
        freeze_frame: The evidence at the moment of confirmation, where ``evidence`` is a later one.
    """

    code: str
    component: str
    source: str
    severity: Literal["info", "warning", "fault"]
    status: FaultStatus
    message: str
    remedy: str
    confidence: float
    first: int
    last: int
    service: str = ""
    occurrences: int = 0
    acknowledged: bool = False
    inhibited_by: str = ""
    suspects: list[str] = []
    evidence: Evidence | None = None
    freeze_frame: Evidence | None = None


class ServiceHealth(Record, kw_only=True):
    """A service as the aggregator sees it.

    Attributes:
        name: ``<service>/<instance>``.
        status: ``ready``, ``starting``, ``stopped`` (said goodbye), ``crashed``, ``hung`` (alive
            but its heartbeat is overdue) or ``dead`` (gone without a word).
        since: UTC ns of the last change of status.
        reason: Why.
        lost: Messages that never reached it.
        overrun: Messages it had to drop.
    """

    name: str
    status: Literal["ready", "starting", "stopped", "crashed", "hung", "dead"]
    since: int
    reason: str = ""
    lost: int = 0
    overrun: int = 0


class Transition(Record, kw_only=True):
    """A numbered change of one fault or service, from which times between failures follow.

    Attributes:
        number: Gapless, also over restarts of the aggregator.
        stamp: UTC ns.
        subject: ``<code> <component>`` or a service's name.
        before, after: Its status.
    """

    number: int
    stamp: int
    subject: str
    before: str
    after: str


class Health(Message, kw_only=True):
    """The merged state (``health``): at once on a change, else once a second; latched.

    Attributes:
        level: The worst of what follows; ``unknown`` where a needed service is silent.
        summary: One line for people.
        capabilities: What the robot can still do (``can_command`` …), each true, false or absent
            if unknown.
        faults: Confirmed first, then unknown, pending, healed.
        services: By name.
        transitions: The latest changes, newest last.
    """

    level: Level
    summary: str
    capabilities: dict[str, bool] = {}
    faults: list[FaultRecord] = []
    services: list[ServiceHealth] = []
    transitions: list[Transition] = []


class HealthRequest(Record, kw_only=True):
    """A query on ``health/request``.

    Attributes:
        operation: ``get`` the latest health, ``acknowledge`` (seen) or ``clear`` (forget a healed
            fault; an active one stays).
        code, component: Which fault; both empty for all.
    """

    operation: Literal["get", "acknowledge", "clear"] = "get"
    code: str = ""
    component: str = ""


class HealthReply(Message, kw_only=True):
    """Answer to a health request."""

    ok: bool
    text: str
    health: Health | None = None
