"""What to send next. Pure: time and outcomes come in as arguments.

A cycle reads position, velocity and current of every servo that is present, in cable order. Between
cycles, in what time is left over, servos that are missing are pinged (:mod:`wackel_gateway.pings`)
and slow registers are read (:mod:`wackel_gateway.slow_reads`).

In a sync read each servo waits for the one before it, so a silent one silences all behind it. Hence
the rest is asked again in the same cycle without the first missing one, and every missing servo
leaves the cycle until a ping of its own is answered. Pings also are how servos join at the start.
A servo that is there thus never misses more than one cycle because of another.

Devices that are no servos, such as a board with a gyro, are read behind them, each by itself.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from wackel_gateway.job import Job, Stage, read_device, read_together
from wackel_gateway.pings import Pings
from wackel_gateway.presence import Presence, present, setback_ns
from wackel_gateway.roster import Block, Roster
from wackel_gateway.slow_reads import SlowReads
from wackel_protocols.dynamixel2.answers import Answers

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
_PING_BYTES = 3
"""What a ping's answer holds: model number and firmware."""


@dataclass(slots=True)
class _Device:
    """A device that every cycle reads."""

    job: Job
    missed: int = 0  # answers in a row
    not_before_ns: int = 0

    def done(self, answers: Answers, now_ns: int) -> None:
        self.missed = self.missed + 1 if answers.missing else 0
        if self.missed >= _SCATTERED_LIMIT:
            self.not_before_ns = now_ns + setback_ns(self.missed - _SCATTERED_LIMIT)


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
        self._period_ns = round(1e9 / rate)
        self._fast_allowed = fast
        self._chain = {
            id_: Presence(member, place)
            for place, (id_, member) in enumerate(roster.members.items())
        }
        self._devices = {(id_, block): _Device(read_device(id_, block)) for id_, block in devices}
        self._pings = Pings(self._chain)
        self._slow = SlowReads(self._chain, now_ns)
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
        for device in self._devices.values():
            device.missed = device.not_before_ns = 0
        for servo in self._chain.values():
            servo.restart()
        self._pings.restart()
        self._slow.restart(now_ns)

    @property
    def present(self) -> tuple[int, ...]:
        """Servos that the cycle asks, in cable order."""
        return present(self._chain)

    @property
    def fast(self) -> bool:
        """Whether the cycle uses Fast Sync Read for all it asks."""
        jobs = self._cycle()
        return bool(jobs) and all(job.is_fast for job in jobs)

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
                elif answers.statuses:
                    self._slow.answered(job, answers, took_ns, ended_ns)
            case Stage.COMMAND:
                pass

    def heard(self, answers: Answers) -> None:
        """Has the reason read at once when a servo begins to raise its alert bit.

        Apart from :meth:`done`, because it can be called when the next job is on its way already.
        """
        self._slow.heard(answers.statuses)

    # The cycle.

    def _cycle(self) -> list[Job]:
        """Reads of all present servos: one for each place where registers lie, in cable order."""
        if self._cycle_jobs is None:
            groups: dict[Block, list[Presence]] = {}
            for servo in self._chain.values():
                block = servo.member.cycle_block
                if servo.present and block is not None:
                    groups.setdefault(block, []).append(servo)
            self._cycle_jobs = [
                read_together(
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
            if job.is_fast:
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
        if job.is_fast:
            # Damage in a fast answer hits all behind it; a plain read tells who is silent.
            self._jobs.appendleft(read_together(Stage.PLAIN, job.block, tail, fast=False))
            return
        if answered and job.stage is Stage.PLAIN:
            self._strike(now_ns)
        self._suspect(tail[0], now_ns)
        rest = tail[1:]
        if rest and (answered or job.stage is not Stage.REST):
            self._jobs.appendleft(read_together(Stage.REST, job.block, rest, fast=False))
        else:
            for servo_id in rest:
                self._suspect(servo_id, now_ns)

    def _prove(self, ids: Iterable[int]) -> None:
        for servo_id in ids:
            servo = self._chain[servo_id]
            servo.proven = True
            servo.scattered = servo.setbacks = 0
        self._needs_proof = any(
            servo.present and (not servo.proven or servo.scattered)
            for servo in self._chain.values()
        )

    def _strike(self, now_ns: int) -> None:
        """A plain read was answered where a fast one was not."""
        self._fast_strikes += 1
        if self._fast_strikes >= _FAST_STRIKES:
            self._fast_strikes = 0
            self._fast_from_ns = now_ns + _FAST_PAUSE_NS
            self._cycle_jobs = None

    def _lost_alone(self, servo_id: int, now_ns: int) -> None:
        servo = self._chain[servo_id]
        servo.scattered += 1
        self._needs_proof = True
        if servo.scattered >= _SCATTERED_LIMIT:
            self._suspect(servo_id, now_ns)

    def _suspect(self, servo_id: int, now_ns: int) -> None:
        """Out of the cycle until a ping is answered."""
        servo = self._chain[servo_id]
        if servo.present and not servo.proven:
            servo.setbacks += 1
            servo.not_before_ns = now_ns + setback_ns(servo.setbacks)
        servo.present = servo.proven = False
        servo.scattered = 0
        self._slow.left(servo_id)
        self._pings.add(servo_id)
        self._cycle_jobs = None

    # What runs between cycles.

    def _extra(self, now_ns: int) -> Job | None:
        """A job that fits before the next cycle, or the one that may delay it."""
        slow, pings = self._slow, self._pings
        if not (pings.fresh or pings.silent or slow.due(now_ns)):
            return None
        saved_ns = self._spare_ns + _SPARE_SHARE * (now_ns - self._spare_since_ns)
        self._spare_ns = max(-_SPARE_LIMIT_NS, min(_SPARE_LIMIT_NS, saved_ns))
        self._spare_since_ns = now_ns
        costs = self._costs.means
        # Twice the mean: what is sent into the pause shall not delay the cycle behind it.
        fits = {kind: self.due_ns - now_ns >= 2 * cost for kind, cost in costs.items()}
        # What costs more than can be saved up is run on credit, which the debt repays. Else after
        # one job in which the computer slept, no other would ever show that they are cheap.
        afforded = {
            kind: self._spare_ns >= min(cost, _SPARE_LIMIT_NS) for kind, cost in costs.items()
        }
        # Whatever is new may cost time at once, one job a cycle, for it says what has happened.
        if slow.urgent and (fits["slow"] or not self._extra_ran):
            job = slow.next_urgent()
            if job is not None:
                return self._run_extra(job, delays=not fits["slow"])
        if pings.fresh and (fits["silent"] or not self._extra_ran):
            job = pings.next_fresh(now_ns)
            if job is not None:
                return self._run_extra(job, delays=not fits["silent"])
        if pings.silent and afforded["silent"] and (fits["silent"] or not self._extra_ran):
            job = pings.next_silent(now_ns)
            if job is not None:
                return self._run_extra(job, delays=not fits["silent"])
        if slow.doubted and (fits["slow"] or not self._extra_ran):
            job = slow.next_doubted()
            if job is not None:
                return self._run_extra(job, delays=not fits["slow"])
        if fits["slow"] or (afforded["slow"] and not self._extra_ran):
            job = slow.next_usual(now_ns)
            if job is not None:
                return self._run_extra(job, delays=not fits["slow"])
        return None

    def _run_extra(self, job: Job, *, delays: bool) -> Job:
        self._extra_ran = True
        self._delays = delays
        return job

    def _pinged(self, servo_id: int, answers: Answers, took_ns: int, now_ns: int) -> None:
        if answers.missing:
            self._costs.add("silent", took_ns)
            self._pings.missed(servo_id)
            return
        servo = self._chain[servo_id]
        servo.present = True
        self._needs_proof = True
        self._cycle_jobs = None
        for status in answers.statuses:
            if len(status.parameters) == _PING_BYTES:
                number = int.from_bytes(status.parameters[:2], "little")
                servo.member.identify(number, status.parameters[2])
        self._slow.joined(servo_id, now_ns)
        self._pings.answered(servo_id)


def _tail(ids: Sequence[int], missing: Sequence[int]) -> tuple[int, ...]:
    """The missing servos behind the last one that answered."""
    start = len(ids)
    while start and ids[start - 1] in missing:
        start -= 1
    return tuple(ids[start:])
