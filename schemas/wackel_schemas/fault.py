"""Fault reports: what a service found, where, and what convicts it."""

from typing import Literal

from wackel_schemas.bus import Transaction
from wackel_schemas.message import Message, Record


class Evidence(Record, kw_only=True):
    """What convicts a component.

    Attributes:
        summary: One line: what was seen and what was expected.
        values: The numbers behind it, by name with unit (``failure_rate``, ``drop_V``).
        transaction: The raw transaction that tipped the decision.
    """

    summary: str
    values: dict[str, float | int | str] = {}
    transaction: Transaction | None = None


class FaultReport(Message, kw_only=True):
    """One fault, published at once when it begins, changes its place or heals (``fault/<source>``).

    Attributes:
        code: A key of :data:`wackel_schemas.fault_codes.FAULT_CODES`.
        component: What is faulty, as a path (see :mod:`wackel_schemas.component`).
        status: ``active`` or ``healed``.
        confidence: Probability that code and component are right, 0 … 1.
        message: A plain sentence that names code and component.
        remedy: What to do about it.
        evidence: What convicts it.
        suspects: Other components that the evidence fits as well, likeliest first.
        since: UTC ns of the first evidence.
        repeated: The same report again, for those who came later; sent once a second while the
            fault is active.
    """

    code: str
    component: str
    status: Literal["active", "healed"]
    confidence: float
    message: str
    remedy: str
    evidence: Evidence
    since: int
    suspects: list[str] = []
    repeated: bool = False
