"""Which findings others explain: of those only the cause is reported.

The aggregator inhibits, too, by its own table; here is what only the classifier knows: place, time
and what the evidence has in common.
"""

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_schemas import component
from wackel_schemas.fault_codes import EXPLAINS

SAME_TIME_NS = 1_000_000_000
"""Faults that begin within this time may have one cause: a silent servo is confirmed by several
requests, a jammer by the next transaction."""
INTERRUPTED_NS = 3_000_000_000
"""Longer than a moving cable interrupts and a servo then restarts: from then on it is a break."""

_WIDE = frozenset(("permanent_jammer", "noise", "loose_contact", "latency_timer"))
"""Faults that concern the whole bus, so what they explain they explain wherever it shows."""
_ALSO = {
    "permanent_jammer": frozenset(("loose_contact",)),
    "rhythmic_jammer": frozenset(("stray_data",)),
    # Answers that the adapter delivers when the host no longer waits look like any of these.
    "latency_timer": frozenset(
        ("stray_data", "packet_loss", "loose_contact", "noise", "unexpected_servo", "duplicate_id")
    ),
    "adapter_lag": frozenset(("stray_data",)),  # what it held back collides with what is asked next
    "duplicate_id": frozenset(("stray_data",)),
    "low_supply": frozenset(("undervoltage",)),
    "lost_signal": frozenset(("stray_data", "packet_loss")),
    "packet_loss": frozenset(("stray_data",)),  # two losses in one answer leave half packets
    "crc_errors": frozenset(("stray_data",)),
}
_GONE = frozenset(("cable_break", "lost_signal", "servo_silent", "servo_unheard"))
_NEVER_ALONE = "unclassified"


def explain(findings: list[Finding], chain: Chain, stamp: int) -> list[Finding]:
    """The findings that no other one explains, with the place of a jammer where it is known."""
    findings = _place_jammer(findings, chain)
    if any(finding.code != _NEVER_ALONE for finding in findings):
        findings = [finding for finding in findings if finding.code != _NEVER_ALONE]
    return [
        finding
        for finding in findings
        if not any(_explains(cause, finding, chain, stamp) for cause in findings)
    ]


def _explains(cause: Finding, finding: Finding, chain: Chain, stamp: int) -> bool:
    code = finding.code
    if cause.code in _WIDE and code in EXPLAINS[cause.code]:
        return True
    if code in _ALSO.get(cause.code, ()):
        return True
    if cause.code == "duplicate_id" and code in EXPLAINS["duplicate_id"]:
        return _concerns(finding, cause.component, chain)
    if cause.code == "loose_contact" and code in _GONE:
        # While the contact is open, and while servos restart after it, those behind it are gone;
        # where no other reason is known, it is that one for as long as it is loose.
        passing = code == "servo_unheard" or stamp - finding.since < INTERRUPTED_NS
        return passing and _is_behind(finding, cause.component, chain)
    if cause.code == "contact_resistance" and code == "undervoltage":
        return finding.component in _supplied_through(cause.component, chain)
    return False


def _concerns(finding: Finding, servo: str, chain: Chain) -> bool:
    """Whether a finding blames a servo, or the cable that leads to it."""
    if servo in (finding.component, *finding.suspects):
        return True
    return any(
        finding.component == chain.cable(position)
        for position in range(len(chain))
        if chain.servo(position) == servo
    )


def _is_behind(finding: Finding, cable: str, chain: Chain) -> bool:
    """Whether all that is missing lies behind a cable; anything, if no cable is known.

    With supply from the far end those before the cable lose their supply.
    """
    if chain.power == "far":
        return True
    for position in range(len(chain)):
        if chain.cable(position) == cable:
            places = range(position, len(chain))
            behind = [chain.cable(place) for place in places] + [chain.servo(p) for p in places]
            return finding.component in behind or cable in finding.suspects
    return True


def _supplied_through(cable: str, chain: Chain) -> list[str]:
    """The servos whose supply comes through a cable."""
    for position in range(len(chain)):
        if chain.cable(position) == cable:
            places = range(position, len(chain)) if chain.power == "adapter" else range(position)
            return [chain.servo(place) for place in places]
    return []


def _place_jammer(findings: list[Finding], chain: Chain) -> list[Finding]:
    """A jammer resembles a servo that does not send (thesis, 2.5.4): if one fell silent when the
    jamming began, it is the jammer, and stays so while the jamming lasts.
    """
    jammer = next((f for f in findings if f.code in ("rhythmic_jammer", "permanent_jammer")), None)
    if jammer is None:
        return findings
    mute = [
        finding
        for finding in findings
        if (finding.code == "servo_silent" or _is_last_servo(finding, chain))
        and abs(finding.since - jammer.since) <= SAME_TIME_NS
    ]
    if len(mute) == 1 and jammer.component == component.bus(chain.bus):
        last = mute[0].code == "cable_break"
        jammer.component = mute[0].suspects[0] if last else mute[0].component
        jammer.suspects = [mute[0].component] if last else []
        jammer.confidence = 0.7 if last else 0.9
        jammer.summary += "; it fell silent when that began"
    blamed = (jammer.component, *jammer.suspects)
    return [f for f in findings if f not in mute or f.component not in blamed]


def _is_last_servo(finding: Finding, chain: Chain) -> bool:
    return finding.code == "cable_break" and finding.component == chain.cable(len(chain) - 1)
