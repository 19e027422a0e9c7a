"""What to send next. Pure: time and outcomes come in as arguments.

A cycle reads position, velocity and current of every servo that is present, in cable order. Between
cycles, in what time is left over, servos that are missing are pinged and slow registers are read.

In a sync read each servo waits for the one before it, so a silent one silences all behind it. Hence
the rest is asked again in the same cycle without the first missing one, and every missing servo
leaves the cycle until a ping of its own is answered. Pings also are how servos join at the start.
A servo that is there thus never misses more than one cycle because of another.

A servo that answers at another time than it used to, and voltages once one of them falls, are asked
again at once, for what has changed must be told within a second; after some answers it is usual.

Devices that are no servos, such as a board with a gyro, are read behind them, each by itself.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from heapq import heapify, heappop, heappush

from wackel_gateway.roster import Block, Member, Roster
from wackel_gateway.usual import Usual
from wackel_protocols.dynamixel2 import packet
from wackel_protocols.dynamixel2.answers import Answers
from wackel_schemas.bus import Purpose

_SPARE_SHARE = 0.1
"""Share of bus time for silent servos and slow work where cycles leave no pause between them."""
_SPARE_LIMIT_NS = 20_000_000
"""How much of it can be saved up or owed: about one ping that nobody answers."""
_SCATTERED_LIMIT = 3
"""So many answers in a row lost alone: at 1 % ordinary loss once in a million reads."""
_FAST_STRIKES = 3
"""So many fast reads in a row that were not answered in full where a plain one at once was."""
_FAST_PAUSE_NS = 60_000_000_000
"""Then fast reads are tried again so much later: it may have been a jammer's doing."""
_SETBACK_NS = 10_000_000
_MAX_SETBACK_NS = 1_000_000_000
"""A servo that answers pings but no reads is tried again after 10 ms, 20 ms, … 1 s; a device that
is silent, too."""
_PING_BYTES = 3
"""What a ping's answer holds: model number and firmware."""


class Stage(Enum):
    """What a job is for, which decides what follows from its outcome."""

    COMMAND = auto()
    CYCLE = auto()
    PLAIN = auto()
    REST = auto()
    DEVICE = auto()
    PING = auto()
    SLOW = auto()


@dataclass(frozen=True, slots=True)
class Job:
    """One instruction to send.

    Attributes:
        stage: What it is for.
        purpose: How it is published.
        instruction: Its bytes.
        ids: Servos that it asks.
        block: What it reads; absent if nothing.
    """

    stage: Stage
    purpose: Purpose
    instruction: bytes
    ids: tuple[int, ...] = ()
    block: Block | None = None


@dataclass(frozen=True)
class _Slow:
    """Registers that are read now and then, as a block; with how many ns between."""

    names: tuple[str, ...]
    period_ns: int


_SLOW = (
    _Slow(("present_input_voltage", "present_temperature"), 500_000_000),
    _Slow(("torque_enable", "hardware_error_status"), 1_000_000_000),
    # Only a write changes it, and that mostly shows in when the other reads are answered.
    _Slow(("return_delay_time",), 2_000_000_000),
)
_VOLTAGE, _HARDWARE_ERROR, _RETURN_DELAY = range(len(_SLOW))
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
_PROOFS = 4
"""Pings that convict a silent servo; ordinary loss takes so many in a row once in 10^12."""


@dataclass(slots=True)
class _Presence:
    """Where a servo stands in the schedule."""

    member: Member
    place: int  # in the chain
    present: bool = False
    proven: bool = False  # has answered a read since it joined
    scattered: int = 0  # answers in a row lost though servos behind it answered
    setbacks: int = 0  # times in a row it answered a ping but not the read that followed
    not_before_ns: int = 0
    waiting: bool = False  # is in one of the two queues for pings
    pings: int = 0  # in a row that were not answered
    usual: dict[Block, Usual] = field(default_factory=dict)  # when it answers alone
    volts: float | None = None


@dataclass(slots=True)
class _Device:
    """A device that every cycle reads."""

    job: Job
    missed: int = 0  # answers in a row
    not_before_ns: int = 0

    def done(self, answers: Answers, now_ns: int) -> None:
        self.missed = self.missed + 1 if answers.missing else 0
        if self.missed >= _SCATTERED_LIMIT:
            setbacks = min(self.missed - _SCATTERED_LIMIT, 7)
            self.not_before_ns = now_ns + min(_SETBACK_NS << setbacks, _MAX_SETBACK_NS)


@dataclass(slots=True)
class _Costs:
    """What a job of each kind takes, ns; running means of the outcomes."""

    means: dict[str, float] = field(default_factory=lambda: {"silent": 5e6, "slow": 1e6})

    def add(self, kind: str, took_ns: int) -> None:
        self.means[kind] += (took_ns - self.means[kind]) / 8


class Schedule:
    """The master's plan for one bus.

    Attributes:
        due_ns: When the next cycle begins; nothing needs to be asked before if :meth:`next` gives
            nothing.
        cycles: Cycles begun.
    """

    def __init__(
        self,
        roster: Roster,
        rate: float,
        devices: Iterable[tuple[int, Block]] = (),
        *,
        fast: bool,
        now_ns: int,
    ) -> None:
        """Starts with no servo known to be present.

        Args:
            roster: The servos.
            rate: Cycles a second.
            devices: Id and what to read of each device that is no servo.
            fast: Use Fast Sync Read where every servo's firmware knows it.
            now_ns: Now.
        """
        self._roster = roster
        self._period_ns = round(1e9 / rate)
        self._fast_allowed = fast
        self._servos = {
            id_: _Presence(member, place)
            for place, (id_, member) in enumerate(roster.members.items())
        }
        self._devices = {(id_, block): _Device(_device_job(id_, block)) for id_, block in devices}
        self.cycles = 0
        self.restart(now_ns)

    def restart(self, now_ns: int) -> None:
        """Everything anew: the adapter is back, and nobody knows what changed meanwhile."""
        self.due_ns = now_ns
        self._commands: list[bytes] = []
        self._jobs: deque[Job] = deque()
        self._cycle_jobs: list[Job] | None = None
        self._fast_strikes = 0
        self._fast_from_ns = now_ns
        self._fast_now = True
        self._extra_ran = False
        self._delays = False  # whether the latest job between cycles may delay the next one
        self._spare_ns = 0.0
        self._spare_since_ns = now_ns
        self._costs = _Costs()
        self._needs_proof = False  # some servo has joined without a read yet, or lost answers
        self._alerted: set[int] = set()
        self._urgent: deque[int] = deque()
        self._doubted: dict[int, None] = {}  # servos to ask again, in order
        self._doubts = _DOUBTS_MOST  # that may still be followed up
        self._doubts_since_ns = now_ns
        self._controls = 0  # servos asked between questions to those in doubt
        self._control_due = True
        self._swept_ns = now_ns - _SWEEP_PAUSE_NS
        self._sweep: deque[int] = deque()
        self._fresh: deque[int] = deque()
        self._silent: deque[int] = deque()
        self._slow: list[tuple[int, int, int]] = []
        for device in self._devices.values():
            device.missed = device.not_before_ns = 0
        for servo_id, servo in self._servos.items():
            servo.present = servo.proven = False
            servo.setbacks = servo.scattered = servo.not_before_ns = 0
            servo.usual.clear()
            servo.volts = None
            servo.waiting = True
            self._fresh.append(servo_id)

    @property
    def present(self) -> tuple[int, ...]:
        """Servos that the cycle asks, in cable order."""
        return tuple(servo_id for servo_id, servo in self._servos.items() if servo.present)

    @property
    def fast(self) -> bool:
        """Whether the cycle uses Fast Sync Read for all it asks."""
        jobs = self._cycle()
        return bool(jobs) and all(_is_fast(job) for job in jobs)

    def command(self, writes: Iterable[bytes]) -> None:
        """Instructions to send at the head of the next cycle."""
        self._commands.extend(writes)

    def next(self, now_ns: int) -> Job | None:
        """The instruction to send now; nothing until :attr:`due_ns` if absent."""
        if self._jobs:
            return self._jobs.popleft()
        extra = self._extra(now_ns)
        if extra is not None:
            return extra
        if now_ns < self.due_ns:
            self._extra_ran = True  # there is a pause; what comes up late in it can wait
            return None
        # Where the wire is slower than the rate, what could not be kept is not made up for.
        self.due_ns = max(now_ns, self.due_ns + self._period_ns)
        self._extra_ran = False
        self._jobs.extend(Job(Stage.COMMAND, "command", write) for write in self._commands)
        self._commands.clear()
        if self._fast_now != (now_ns >= self._fast_from_ns):
            self._fast_now = not self._fast_now
            self._cycle_jobs = None
        self._jobs.extend(self._cycle())
        if self._devices:
            self._jobs.extend(d.job for d in self._devices.values() if d.not_before_ns <= now_ns)
        if not self._jobs:
            return self._extra(now_ns)
        self.cycles += 1
        return self._jobs.popleft()

    def done(self, job: Job, answers: Answers, begin_ns: int, ended_ns: int) -> None:
        """What became of a job."""
        took_ns = ended_ns - begin_ns
        match job.stage:
            case Stage.CYCLE | Stage.PLAIN | Stage.REST:
                self._read(job, answers, ended_ns)
            case Stage.DEVICE:
                assert job.block is not None
                self._devices[job.ids[0], job.block].done(answers, ended_ns)
            case Stage.PING:
                self._spare_ns -= took_ns
                self._pinged(job.ids[0], answers, took_ns, ended_ns)
            case Stage.SLOW:
                # What fitted into the pause has delayed nothing; it must not starve the silent.
                self._spare_ns -= took_ns if self._delays else 0
                self._costs.add("slow", took_ns)
                if answers.missing:
                    self._suspect(job.ids[0], ended_ns)
                elif job.block is not None and answers.statuses:
                    self._answered_alone(job.ids[0], job.block, answers, took_ns, ended_ns)
            case Stage.COMMAND:
                pass

    def heard(self, answers: Answers) -> None:
        """Has the reason read at once when a servo begins to raise its alert bit.

        Apart from :meth:`done`, because it can be called when the next job is on its way already.
        """
        alerted = self._alerted
        for servo_id, error, _, _ in answers.statuses:
            if (error >= packet.ALERT) != (servo_id in alerted) and servo_id in self._servos:
                if error < packet.ALERT:
                    alerted.discard(servo_id)
                else:
                    alerted.add(servo_id)
                    self._urgent.append(servo_id)
                    self._sweep_voltages()

    # The cycle.

    def _cycle(self) -> list[Job]:
        """Reads of all present servos: one for each place where registers lie, in cable order."""
        if self._cycle_jobs is None:
            groups: dict[Block, list[_Presence]] = {}
            for servo in self._servos.values():
                block = servo.member.cycle_block
                if servo.present and block is not None:
                    groups.setdefault(block, []).append(servo)
            self._cycle_jobs = [
                _read_job(
                    Stage.CYCLE,
                    block,
                    tuple(servo.member.id for servo in servos),
                    fast=self._fast_allowed
                    and self._fast_now
                    and all(servo.member.knows_fast_sync_read for servo in servos),
                )
                for block, servos in groups.items()
            ]
        return self._cycle_jobs

    def _read(self, job: Job, answers: Answers, now_ns: int) -> None:
        missing = answers.missing
        if not missing:
            if self._needs_proof:
                self._prove(job.ids)
            if _is_fast(job):
                self._fast_strikes = 0
            elif job.stage is Stage.PLAIN:
                self._strike(now_ns)
            return
        answered = [servo_id for servo_id in job.ids if servo_id not in missing]
        self._prove(answered)
        tail = _tail(job.ids, missing)
        for servo_id in missing:
            if servo_id not in tail:
                self._lost_alone(servo_id, now_ns)
        if not tail:
            return
        assert job.block is not None
        if _is_fast(job):
            # Damage in a fast answer hits all behind it; a plain read tells who is silent.
            self._jobs.appendleft(_read_job(Stage.PLAIN, job.block, tail, fast=False))
            return
        if answered and job.stage is Stage.PLAIN:
            self._strike(now_ns)
        self._suspect(tail[0], now_ns)
        rest = tail[1:]
        if rest and (answered or job.stage is not Stage.REST):
            self._jobs.appendleft(_read_job(Stage.REST, job.block, rest, fast=False))
        else:
            for servo_id in rest:
                self._suspect(servo_id, now_ns)

    def _prove(self, ids: Iterable[int]) -> None:
        for servo_id in ids:
            servo = self._servos[servo_id]
            servo.proven = True
            servo.scattered = servo.setbacks = 0
        self._needs_proof = any(
            servo.present and (not servo.proven or servo.scattered)
            for servo in self._servos.values()
        )

    def _strike(self, now_ns: int) -> None:
        """A plain read was answered where a fast one was not."""
        self._fast_strikes += 1
        if self._fast_strikes >= _FAST_STRIKES:
            self._fast_strikes = 0
            self._fast_from_ns = now_ns + _FAST_PAUSE_NS
            self._cycle_jobs = None

    def _lost_alone(self, servo_id: int, now_ns: int) -> None:
        servo = self._servos[servo_id]
        servo.scattered += 1
        self._needs_proof = True
        if servo.scattered >= _SCATTERED_LIMIT:
            self._suspect(servo_id, now_ns)

    def _suspect(self, servo_id: int, now_ns: int) -> None:
        """Out of the cycle until a ping is answered."""
        servo = self._servos[servo_id]
        if servo.present and not servo.proven:
            servo.setbacks += 1
            pause_ns = min(_SETBACK_NS << min(servo.setbacks, 7), _MAX_SETBACK_NS)
            servo.not_before_ns = now_ns + pause_ns
        servo.present = servo.proven = False
        servo.scattered = 0
        servo.volts = None
        self._doubted.pop(servo_id, None)
        self._cycle_jobs = None
        if not servo.waiting:
            servo.waiting = True
            self._fresh.append(servo_id)

    # What runs between cycles.

    def _extra(self, now_ns: int) -> Job | None:
        """A job that fits before the next cycle, or the one that may delay it."""
        slow_is_due = self._slow and self._slow[0][0] <= now_ns
        if not (
            slow_is_due
            or self._doubted
            or self._sweep
            or self._urgent
            or self._fresh
            or self._silent
        ):
            return None
        saved_ns = self._spare_ns + _SPARE_SHARE * (now_ns - self._spare_since_ns)
        self._spare_ns = max(-_SPARE_LIMIT_NS, min(_SPARE_LIMIT_NS, saved_ns))
        self._spare_since_ns = now_ns
        costs = self._costs.means
        # Twice the mean: what is sent into the pause shall not delay the cycle behind it.
        fits = {kind: self.due_ns - now_ns >= 2 * cost for kind, cost in costs.items()}
        # Whatever is new may cost time at once, one job a cycle, for it says what has happened.
        if self._urgent and (fits["slow"] or not self._extra_ran):
            job = self._slow_job(_HARDWARE_ERROR, self._urgent.popleft())
            if job is not None:
                return self._run_extra(job, delays=not fits["slow"])
        if self._fresh and (fits["silent"] or not self._extra_ran):
            job = self._ping(self._fresh, now_ns)
            if job is not None:
                return self._run_extra(job, delays=not fits["silent"])
        # A ping that costs more than can be saved up is run on credit, which the debt repays.
        afforded = self._spare_ns >= min(costs["silent"], _SPARE_LIMIT_NS)
        if self._silent and afforded and (fits["silent"] or not self._extra_ran):
            job = self._ping(self._by_need(), now_ns)
            if job is not None:
                return self._run_extra(job, delays=not fits["silent"])
        if self._doubted and (fits["slow"] or not self._extra_ran):
            job = self._doubt()
            if job is not None:
                return self._run_extra(job, delays=not fits["slow"])
        if fits["slow"] or (self._spare_ns >= costs["slow"] and not self._extra_ran):
            job = self._voltage() or self._due(now_ns)
            if job is not None:
                return self._run_extra(job, delays=not fits["slow"])
        return None

    def _doubt(self) -> Job | None:
        """Asks a servo that answers at another time than usual once more, for its register."""
        while self._doubted:
            servo_id = next(iter(self._doubted))
            others = [other for other in self.present if other not in self._doubted]
            if self._control_due and others and len(self._doubted) <= _DOUBTED_ALONE:
                self._controls += 1
                servo_id = others[self._controls % len(others)]
            self._control_due = servo_id in self._doubted
            job = self._slow_job(_RETURN_DELAY, servo_id)
            if job is not None:
                return job
            self._doubted.pop(servo_id, None)
        return None

    def _voltage(self) -> Job | None:
        """The next voltage of a sweep along the chain."""
        while self._sweep:
            servo_id = self._sweep.popleft()
            job = self._slow_job(_VOLTAGE, servo_id)
            if job is not None and self._servos[servo_id].present:
                return job
        return None

    def _due(self, now_ns: int) -> Job | None:
        """The slow read whose time has come."""
        while self._slow and self._slow[0][0] <= now_ns:
            _, kind, servo_id = heappop(self._slow)
            servo = self._servos[servo_id]
            if servo.present:
                # Each has its own moment within the period, so that none waits for many others and
                # what befalls the bus soon meets one of them.
                period_ns = _SLOW[kind].period_ns
                phase_ns = (servo.place / len(self._servos) + kind / len(_SLOW)) * period_ns
                earliest_ns = now_ns + period_ns // 2
                due_ns = earliest_ns + (round(phase_ns) - earliest_ns) % period_ns
                heappush(self._slow, (due_ns, kind, servo_id))
                job = self._slow_job(kind, servo_id)
                if job is not None:
                    return job
        return None

    def _answered_alone(
        self, servo_id: int, block: Block, answers: Answers, took_ns: int, now_ns: int
    ) -> None:
        """Looks for signs that something has changed, which are followed up at once."""
        servo = self._servos[servo_id]
        self._doubted.pop(servo_id, None)
        usual = servo.usual.setdefault(block, Usual())
        if usual.departs(took_ns):
            if len(self._doubted) == _DOUBTED_MOST:
                usual.accept()
            elif self._may_doubt(now_ns):
                self._doubted[servo_id] = None
        volts = _volts(servo.member, block, answers)
        if volts is None:
            return
        before, servo.volts = servo.volts, volts
        sagged = before is not None and abs(volts - before) >= _SAG_V
        if sagged and now_ns - self._swept_ns >= _SWEEP_PAUSE_NS:
            self._swept_ns = now_ns
            self._sweep_voltages()

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
            self._sweep.extend(self.present * _SWEEPS)

    def _run_extra(self, job: Job, *, delays: bool) -> Job:
        self._extra_ran = True
        self._delays = delays
        return job

    def _ping(self, waiting: deque[int], now_ns: int) -> Job | None:
        """The ping of the first in the queue whose time has come."""
        for _ in range(len(waiting)):
            servo_id = waiting.popleft()
            if self._servos[servo_id].not_before_ns <= now_ns:
                return Job(Stage.PING, "ping", packet.ping(servo_id), (servo_id,))
            waiting.append(servo_id)
        return None

    def _by_need(self) -> deque[int]:
        """The silent servos; first those of which a few more pings tell what has happened.

        These are the ones with others behind them that answer, and the first of those at the end.
        """
        last = max((s.place for s in self._servos.values() if s.present), default=-1)
        for servo_id in self._silent:
            servo = self._servos[servo_id]
            if servo.pings < _PROOFS and servo.place <= last + 1:
                self._silent.remove(servo_id)
                self._silent.appendleft(servo_id)
                break
        return self._silent

    def _pinged(self, servo_id: int, answers: Answers, took_ns: int, now_ns: int) -> None:
        servo = self._servos[servo_id]
        if answers.missing:
            servo.pings += 1
            self._costs.add("silent", took_ns)
            self._silent.append(servo_id)
            return
        servo.waiting = False
        servo.present = True
        servo.pings = 0
        self._needs_proof = True
        self._cycle_jobs = None
        for status in answers.statuses:
            if len(status.parameters) == _PING_BYTES:
                number = int.from_bytes(status.parameters[:2], "little")
                servo.member.identify(number, status.parameters[2])
        self._slow = [entry for entry in self._slow if entry[2] != servo_id]
        self._slow.extend((now_ns, kind, servo_id) for kind in range(len(_SLOW)))
        heapify(self._slow)
        # What has come back seldom comes alone.
        self._fresh.extend(self._silent)
        self._silent.clear()

    def _slow_job(self, kind: int, servo_id: int) -> Job | None:
        block = Block.of(self._servos[servo_id].member.model, *_SLOW[kind].names)
        if block is None:
            return None
        instruction = packet.read(servo_id, block.address, block.length)
        return Job(Stage.SLOW, "background", instruction, (servo_id,), block)


def _volts(member: Member, block: Block, answers: Answers) -> float | None:
    """The input voltage, if it is in this block."""
    register = member.model.registers.get("present_input_voltage")
    if register is None or not block.address <= register.address < block.address + block.length:
        return None
    start = register.address - block.address
    data = answers.statuses[0].parameters[start : start + register.length]
    return register.to_si(register.decode(data)) if len(data) == register.length else None


def _read_job(stage: Stage, block: Block, ids: tuple[int, ...], *, fast: bool) -> Job:
    build = packet.fast_sync_read if fast and len(ids) > 1 else packet.sync_read
    return Job(stage, "cycle", build(ids, block.address, block.length), ids, block)


def _device_job(device_id: int, block: Block) -> Job:
    instruction = packet.read(device_id, block.address, block.length)
    return Job(Stage.DEVICE, "cycle", instruction, (device_id,), block)


def _is_fast(job: Job) -> bool:
    return job.instruction[packet.PREFIX_BYTES] == packet.Instruction.FAST_SYNC_READ


def _tail(ids: Sequence[int], missing: Sequence[int]) -> tuple[int, ...]:
    """The missing servos behind the last one that answered."""
    start = len(ids)
    while start and ids[start - 1] in missing:
        start -= 1
    return tuple(ids[start:])
