"""Registers that are read between cycles, each servo by itself: which comes next.

Each has its period. At once are read: the reason when a servo raises its alert bit; all voltages
once one of them falls; and a servo that answers at another time than it used to, for what has
changed must be told within a second; how it goes on to answer then becomes usual.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush

from wackel_gateway.job import Job, read_alone
from wackel_gateway.presence import Chain, present
from wackel_gateway.roster import Block, Member
from wackel_gateway.usual import Usual
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import Answers, Status


@dataclass(frozen=True)
class _Registers:
    """Some that are read as a block; with how many ns between."""

    names: tuple[str, ...]
    period_ns: int


_KINDS = (
    _Registers(("present_input_voltage", "present_temperature"), 500_000_000),
    _Registers(("torque_enable", "hardware_error_status"), 1_000_000_000),
    # Only a write changes it, and that mostly shows in when the other reads are answered.
    _Registers(("return_delay_time",), 2_000_000_000),
)
_VOLTAGE, _HARDWARE_ERROR, _RETURN_DELAY = range(len(_KINDS))
_SAG_V = 0.3
"""Three steps of the voltage register: more than servos that move make on sound cables."""
_SWEEPS = 2
"""Then all voltages are read so often: a diagnosis needs a reading of each after the change."""
_SWEEP_PAUSE_NS = 1_000_000_000
"""Between two such: the supply of a robot that walks hard may never be steady."""
_DOUBTED_MOST = 4
"""Servos at a time that are asked again because they answer at another time than usual; with more
of them it is the adapter or the host, which these few show as well."""
_DOUBTS_MOST = 20.0
"""Departures that may be followed up in a row: two servos', each as often as convicts it."""
_DOUBTS_HZ = 5.0
"""And in the long run: where the host is often late, every third answer departs."""
_DOUBTED_ALONE = 2
"""So few need others asked between them, to be told apart from a late host or adapter."""


@dataclass(slots=True)
class _Known:
    """Of a servo: when it answers, by what is asked, and its voltage."""

    usual: dict[Block, Usual] = field(default_factory=dict)
    volts: float | None = None


class SlowReads:
    """What is to be read.

    Args:
        chain: All servos.
        now_ns: Now.

    Attributes:
        urgent: Servos that have begun to raise their alert bit.
        doubted: Servos to ask again, in order.
    """

    def __init__(self, chain: Chain, now_ns: int) -> None:
        self._chain = chain
        self.restart(now_ns)

    def restart(self, now_ns: int) -> None:
        """Nothing is known of any servo."""
        self._alerted: set[int] = set()
        self.urgent: deque[int] = deque()
        self.doubted: dict[int, None] = {}
        self._doubts = _DOUBTS_MOST  # that may still be followed up
        self._doubts_since_ns = now_ns
        self._controls = 0  # servos asked between questions to those in doubt
        self._control_due = True
        self._swept_ns = now_ns - _SWEEP_PAUSE_NS
        self._sweep: deque[int] = deque()
        self._periodic: list[tuple[int, int, int]] = []  # when, which registers, of whom: a heap
        self._known = {servo_id: _Known() for servo_id in self._chain}

    def joined(self, servo_id: int, now_ns: int) -> None:
        """A servo is there: all of its registers are due."""
        self._periodic = [entry for entry in self._periodic if entry[2] != servo_id]
        self._periodic.extend((now_ns, kind, servo_id) for kind in range(len(_KINDS)))
        heapify(self._periodic)

    def left(self, servo_id: int) -> None:
        """A servo is out of the cycle."""
        self.doubted.pop(servo_id, None)
        self._known[servo_id].volts = None

    def heard(self, statuses: Iterable[Status]) -> None:
        """Has the reason read at once when a servo begins to raise its alert bit."""
        alerted = self._alerted
        for servo_id, error, _, _ in statuses:
            if (error >= packet.ALERT) != (servo_id in alerted) and servo_id in self._chain:
                if error < packet.ALERT:
                    alerted.discard(servo_id)
                else:
                    alerted.add(servo_id)
                    self.urgent.append(servo_id)
                    self._sweep_voltages()

    def due(self, now_ns: int) -> bool:
        """Whether anything is to be read."""
        periodic = self._periodic and self._periodic[0][0] <= now_ns
        return bool(periodic or self.doubted or self._sweep or self.urgent)

    def next_urgent(self) -> Job | None:
        """Why a servo raises its alert bit."""
        return self._job(_HARDWARE_ERROR, self.urgent.popleft())

    def next_doubted(self) -> Job | None:
        """Asks a servo that answers at another time than usual once more, for its register."""
        while self.doubted:
            servo_id = next(iter(self.doubted))
            others = [other for other in present(self._chain) if other not in self.doubted]
            if self._control_due and others and len(self.doubted) <= _DOUBTED_ALONE:
                self._controls += 1
                servo_id = others[self._controls % len(others)]
            self._control_due = servo_id in self.doubted
            job = self._job(_RETURN_DELAY, servo_id)
            if job is not None:
                return job
            self.doubted.pop(servo_id, None)
        return None

    def next_usual(self, now_ns: int) -> Job | None:
        """The next voltage of a sweep along the chain, or what is due by its period."""
        return self._voltage() or self._by_period(now_ns)

    def answered(self, job: Job, answers: Answers, took_ns: int, now_ns: int) -> None:
        """Looks for signs that something has changed, which are followed up at once."""
        (servo_id,), block = job.ids, job.block
        assert block is not None
        known = self._known[servo_id]
        self.doubted.pop(servo_id, None)
        usual = known.usual.setdefault(block, Usual())
        if usual.departs(took_ns):
            if len(self.doubted) == _DOUBTED_MOST:
                usual.accept()
            elif self._may_doubt(now_ns):
                self.doubted[servo_id] = None
        volts = _volts(self._chain[servo_id].member, block, answers)
        if volts is None:
            return
        before, known.volts = known.volts, volts
        sagged = before is not None and abs(volts - before) >= _SAG_V
        if sagged and now_ns - self._swept_ns >= _SWEEP_PAUSE_NS:
            self._swept_ns = now_ns
            self._sweep_voltages()

    def _voltage(self) -> Job | None:
        while self._sweep:
            servo_id = self._sweep.popleft()
            job = self._job(_VOLTAGE, servo_id)
            if job is not None and self._chain[servo_id].present:
                return job
        return None

    def _by_period(self, now_ns: int) -> Job | None:
        while self._periodic and self._periodic[0][0] <= now_ns:
            _, kind, servo_id = heappop(self._periodic)
            servo = self._chain[servo_id]
            if servo.present:
                # Each has its own moment within the period, so that none waits for many others and
                # what befalls the bus soon meets one of them.
                period_ns = _KINDS[kind].period_ns
                phase_ns = (servo.place / len(self._chain) + kind / len(_KINDS)) * period_ns
                earliest_ns = now_ns + period_ns // 2
                due_ns = earliest_ns + (round(phase_ns) - earliest_ns) % period_ns
                heappush(self._periodic, (due_ns, kind, servo_id))
                job = self._job(kind, servo_id)
                if job is not None:
                    return job
        return None

    def _may_doubt(self, now_ns: int) -> bool:
        """Whether a departure may be followed up; if so, it counts."""
        saved = self._doubts + _DOUBTS_HZ * (now_ns - self._doubts_since_ns) / 1e9
        self._doubts = min(_DOUBTS_MOST, saved)
        self._doubts_since_ns = now_ns
        if self._doubts < 1:
            return False
        self._doubts -= 1
        return True

    def _sweep_voltages(self) -> None:
        if not self._sweep:
            self._sweep.extend(present(self._chain) * _SWEEPS)

    def _job(self, kind: int, servo_id: int) -> Job | None:
        block = Block.of(self._chain[servo_id].member.model, *_KINDS[kind].names)
        return None if block is None else read_alone(servo_id, block)


def _volts(member: Member, block: Block, answers: Answers) -> float | None:
    """The input voltage, if it is in this block."""
    register = member.model.registers.get("present_input_voltage")
    if register is None or not block.address <= register.address < block.address + block.length:
        return None
    start = register.address - block.address
    data = answers.statuses[0].parameters[start : start + register.length]
    return register.to_si(register.decode(data)) if len(data) == register.length else None
