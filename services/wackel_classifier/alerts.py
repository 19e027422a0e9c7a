"""What servos say of themselves: alert bit, Hardware Error Status, refused instructions."""

from dataclasses import dataclass

from wackel_classifier.chain import Chain
from wackel_classifier.findings import Finding
from wackel_protocols.dynamixel2.errors import ERROR_NUMBERS, hardware_errors
from wackel_protocols.dynamixel2.packet import ALERT
from wackel_protocols.dynamixel2.tables import Series

DECODE_NS = 1_200_000_000
"""How long to wait for Hardware Error Status before an alert is reported without it: a gateway
reads it at once if the bus has time, else with the slow registers once a second."""
CRC_ERROR = 3
"""Error number of a servo that got a damaged instruction: loss, not a refusal."""
VOLTAGES_NS = 700_000_000
"""How long undervoltage waits for the voltages along the chain, which tell whose fault it is."""
REFUSED_NS = 5_000_000_000
"""How long a refused instruction is told; a second one within it prolongs it."""
_CODES = {
    "input voltage": "undervoltage",
    "motor Hall sensor": "hall_sensor_error",
    "overheating": "overheating",
    "motor encoder": "encoder_error",
    "electrical shock": "electrical_shock",
    "overload": "overload",
}


@dataclass(slots=True)
class _Servo:
    alert_ns: int | None = None
    since: int = 0
    status: int | None = None
    refused_ns: int | None = None
    refused: int = 0
    refused_since: int = 0


class Alerts:
    """Follows the error byte and Hardware Error Status of each servo.

    Args:
        chain: Of the bus.
        series: By position; decides what the bits mean.

    Attributes:
        alerting: The servos that report a hardware error, a bit for each position.
    """

    def __init__(self, chain: Chain, series: list[Series]) -> None:
        self._chain = chain
        self._series = series
        self._servos = [_Servo() for _ in range(len(chain))]
        self._raised = 0
        self.alerting = 0

    def complains(self, position: int) -> bool:
        """Whether a servo reports a hardware error; it may have switched its torque off."""
        return self._servos[position].alert_ns is not None

    def error_byte(self, position: int, error: int, now_ns: int, stamp: int) -> None:
        """A servo has answered with this error byte."""
        servo = self._servos[position]
        if error == (0 if servo.alert_ns is None else ALERT):
            return  # nothing new, by far the most frequent case
        if error & ALERT:
            if servo.alert_ns is None:
                servo.alert_ns, servo.since = now_ns, stamp
        else:
            servo.alert_ns = servo.status = None
        number = error & ~ALERT
        if number and number != CRC_ERROR:
            if servo.refused_ns is None:
                servo.refused_since = stamp
            servo.refused_ns, servo.refused = now_ns, number
        self._count()

    def hardware_error(self, position: int, status: int, now_ns: int, stamp: int) -> bool:
        """Hardware Error Status was read; whether an alert of the servo is news by it."""
        servo = self._servos[position]
        if status == servo.status and bool(status) == (servo.alert_ns is not None):
            return False
        alerted = servo.alert_ns is not None
        servo.status = status
        if status and servo.alert_ns is None:
            servo.alert_ns, servo.since = now_ns, stamp
        elif not status:
            servo.alert_ns = None
        self._count()
        return alerted or bool(status)

    def gone(self, position: int) -> None:
        """A servo is out of reach: what it said before is no longer known."""
        self._servos[position] = _Servo()
        self._count()

    def complaining(self) -> list[int]:
        """Positions of the servos that report a hardware error."""
        if not self._raised:
            return []
        return [place for place, servo in enumerate(self._servos) if servo.alert_ns is not None]

    def undervoltage(self) -> list[int]:
        """Positions of those that are known to mean their input voltage."""
        return [
            place
            for place in self.complaining()
            if "input voltage"
            in hardware_errors(self._servos[place].status or 0, self._series[place])
        ]

    def findings(self, now_ns: int, settled_ns: int) -> list[Finding]:
        """The complaints of all servos.

        Args:
            now_ns: Classifier's time.
            settled_ns: See :attr:`.Supply.settled_ns`.
        """
        findings: list[Finding] = []
        if not self._raised:
            return findings
        for position, servo in enumerate(self._servos):
            if servo.alert_ns is not None:
                early = now_ns - servo.alert_ns < VOLTAGES_NS and servo.alert_ns >= settled_ns
                findings += [
                    finding
                    for finding in self._complaints(position, servo, now_ns)
                    if not (early and finding.code == "undervoltage")
                ]
            if servo.refused_ns is not None:
                if now_ns - servo.refused_ns >= REFUSED_NS:
                    servo.refused_ns = None
                    self._count()
                    continue
                words = ERROR_NUMBERS.get(servo.refused, f"error number {servo.refused}")
                findings.append(
                    Finding(
                        "instruction_error",
                        self._chain.servo(position),
                        1.0,
                        servo.refused_since,
                        f"its answer carries error number {servo.refused}: {words}",
                        {"error_number": servo.refused},
                        words={"error": words},
                    )
                )
        return findings

    def _complaints(self, position: int, servo: _Servo, now_ns: int) -> list[Finding]:
        component = self._chain.servo(position)
        names = hardware_errors(servo.status or 0, self._series[position])
        findings = [
            Finding(
                _CODES[name],
                component,
                0.99,
                servo.since,
                f"alert bit set; Hardware Error Status {servo.status:#04x}: {name}",
                {"hardware_error_status": servo.status or 0},
            )
            for name in names
            if name in _CODES
        ]
        if findings or now_ns - (servo.alert_ns or 0) < DECODE_NS:
            return findings
        return [
            Finding(
                "alert",
                component,
                0.9,
                servo.since,
                "alert bit set; Hardware Error Status could not be read"
                if servo.status is None
                else f"alert bit set; Hardware Error Status {servo.status:#04x} has no known bit",
            )
        ]

    def _count(self) -> None:
        self.alerting = sum(
            1 << place for place, servo in enumerate(self._servos) if servo.alert_ns is not None
        )
        self._raised = sum(
            servo.alert_ns is not None or servo.refused_ns is not None for servo in self._servos
        )
