"""How well the classifier names faults: many random scenarios of each kind on the virtual bus.

Each scenario draws chain length, position, baud rate, rate, load, supply side, strength of the
fault and ordinary loss from its seed. The seeds of ``tune`` were used while thresholds were chosen;
those of ``judge``, which this prints, were not.

Right kind: when the scenario ends, the faults injected are reported, and no others. Right place:
the component is the true one, or the true one is among the suspects where the bus cannot tell more
(the column *by suspects* says how often). First right: nothing else had been reported before, not
even for a moment.
"""

import math
import multiprocessing
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from random import Random

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.classifier.rig import EPOCH_NS, Rig, chain
from wackel_node.config import BusConfig
from wackel_schemas import component
from wackel_schemas.bus import ServoGoal
from wackel_schemas.fault import FaultReport

SCENARIOS = 200
WARM_UP_S = 2.0
SETTLE_S = 1.0
"""How long a scenario goes on after all faults have been found: a diagnosis must hold."""
HEALTHY_S = 3600.0
LOSSES = (0.0, 1e-4, 5e-4, 1e-3)


@dataclass(frozen=True)
class Injected:
    """One fault of a scenario.

    Attributes:
        kind, servo, value: As the virtual bus takes them.
        code: What it must be called.
        truth: The component that is faulty.
    """

    kind: str
    servo: int | None
    value: float | None
    code: str
    truth: str


@dataclass(frozen=True)
class Kind:
    """A row of the table.

    Attributes:
        name: Of the row.
        draw: The faults of one scenario.
        limit_s: How long it is waited for the diagnosis.
        aim_s: p95 of the detection time that is aimed at.
        moving: The servos are given goals all the time.
        least: Servos that it needs.
        power: Where supply may enter.
        from_trace: The time counts from the first answer that the fault costs: a contact that does
            not open cannot be found.
    """

    name: str
    draw: Callable[[Random, BusConfig], list[Injected]]
    limit_s: float = 3.0
    aim_s: float = 1.0
    moving: bool = False
    least: int = 2
    power: tuple[str, ...] = ("adapter", "far", "both")
    from_trace: bool = False


@dataclass
class Result:
    """What became of one scenario.

    Attributes:
        kind: Right kind.
        place: Right place.
        by_suspects: Right place only by the suspects.
        first: First right.
        took_s: From the injection to the last fault rightly named; absent if never.
        before: Reports before the injection.
        reported: Codes that were reported and should not have been.
        seed: To run it again.
    """

    kind: bool
    place: bool
    by_suspects: bool
    first: bool
    took_s: float | None
    before: int
    reported: list[str] = field(default_factory=list)
    seed: str = ""


def _cable(config: BusConfig, position: int) -> str:
    ids = config.ids()
    return component.cable("main", ids[position - 1] if position else None, ids[position])


def _servo(config: BusConfig, position: int) -> str:
    return component.servo("main", config.ids()[position])


def _position(random: Random, config: BusConfig, first: int = 0) -> int:
    return random.randrange(first, len(config.servos))


_STANDBY_A = 0.04
"""What a servo without torque draws: a resistance is chosen to drop 0.8 to 1.5 V at rest."""
_BUS = component.bus("main")
_SUPPLY = component.supply("main")


def _break(random: Random, config: BusConfig, first: int = 0, behind: int = 1) -> list[Injected]:
    at = random.randrange(first, len(config.servos) + 1 - behind)
    # The adapter hears nobody if the servos that it is connected with have lost their supply.
    deaf = at == 0 or config.power == "far"
    code = "lost_signal" if deaf else "cable_break"
    return [Injected("break", config.ids()[at], None, code, _cable(config, at))]


def _silent(random: Random, config: BusConfig) -> list[Injected]:
    at = _position(random, config)
    last = at == len(config.servos) - 1
    code = "cable_break" if last else "servo_silent"
    return [Injected("silent", config.ids()[at], None, code, _servo(config, at))]


def _power_off(random: Random, config: BusConfig) -> list[Injected]:
    return [Injected("power_off", None, None, "lost_signal", _SUPPLY)]


def _loose(kind: str) -> Callable[[Random, BusConfig], list[Injected]]:
    def draw(random: Random, config: BusConfig) -> list[Injected]:
        at = _position(random, config)
        per_s = random.uniform(2.0, 10.0)
        return [Injected(kind, config.ids()[at], per_s, "loose_contact", _cable(config, at))]

    return draw


def _two_loose(random: Random, config: BusConfig) -> list[Injected]:
    places = random.sample(range(len(config.servos)), 2)
    return [
        Injected(
            "loose_contact",
            config.ids()[at],
            random.uniform(3.0, 8.0),
            "loose_contact",
            _cable(config, at),
        )
        for at in places
    ]


def _jammer(kind: str, *, servo: bool) -> Callable[[Random, BusConfig], list[Injected]]:
    def draw(random: Random, config: BusConfig) -> list[Injected]:
        if not servo:
            return [Injected(kind, None, None, kind, _BUS)]
        at = _position(random, config)
        return [Injected(kind, config.ids()[at], None, kind, _servo(config, at))]

    return draw


def _of_bus(
    kind: str, code: str, truth: str, low: float, high: float
) -> Callable[[Random, BusConfig], list[Injected]]:
    def draw(random: Random, config: BusConfig) -> list[Injected]:
        value = math.exp(random.uniform(math.log(low), math.log(high)))
        return [Injected(kind, None, value, code, truth)]

    return draw


def _of_servo(
    kind: str, code: str, low: float | None = None, high: float | None = None
) -> Callable[[Random, BusConfig], list[Injected]]:
    def draw(random: Random, config: BusConfig) -> list[Injected]:
        at = _position(random, config)
        value = None
        if low is not None and high is not None:
            value = math.exp(random.uniform(math.log(low), math.log(high)))
        return [Injected(kind, config.ids()[at], value, code, _servo(config, at))]

    return draw


def _return_delay(random: Random, config: BusConfig) -> list[Injected]:
    right = (config.return_delay_us or 500) // 2
    wrong = random.choice([value for value in range(255) if abs(value - right) >= 20])
    at = _position(random, config)
    return [Injected("return_delay", config.ids()[at], wrong, "return_delay", _servo(config, at))]


def _resistance(random: Random, config: BusConfig) -> list[Injected]:
    at = _position(random, config, 1)
    behind = at if config.power == "far" else len(config.servos) - at
    ohms = random.uniform(0.8, 1.5) / (behind * _STANDBY_A)
    return [
        Injected(
            "contact_resistance", config.ids()[at], ohms, "contact_resistance", _cable(config, at)
        )
    ]


def _latency(random: Random, config: BusConfig) -> list[Injected]:
    value = random.choice((4, 8, 16))
    return [Injected("latency_timer", None, value, "latency_timer", component.adapter("main"))]


def _with_break(kind: str) -> Callable[[Random, BusConfig], list[Injected]]:
    def draw(random: Random, config: BusConfig) -> list[Injected]:
        # A jammer that begins as the last servo falls silent would be that servo.
        return [Injected(kind, None, None, kind, _BUS), *_break(random, config, 1, 2)]

    return draw


def _silent_and_break(random: Random, config: BusConfig) -> list[Injected]:
    broken = _break(random, config, 2)
    at = config.ids().index(broken[0].servo or 0)
    silent = random.randrange(0, at - 1)
    return [
        *broken,
        Injected("silent", config.ids()[silent], None, "servo_silent", _servo(config, silent)),
    ]


_NEAR = ("adapter", "both")

KINDS: tuple[Kind, ...] = (
    Kind("cable break", _break),
    Kind("silent servo", _silent),
    Kind("duplicate id", _of_servo("duplicate_id", "duplicate_id")),
    Kind("power off", _power_off),
    Kind("loose contact, scattered", _loose("loose_contact"), 20.0, 10.0, from_trace=True),
    Kind("loose contact, bursts", _loose("loose_contact_bursts"), 20.0, 10.0, from_trace=True),
    Kind("rhythmic jammer", _jammer("rhythmic_jammer", servo=False)),
    Kind("rhythmic jammer in a servo", _jammer("rhythmic_jammer", servo=True)),
    Kind("permanent jammer", _jammer("permanent_jammer", servo=False)),
    Kind("permanent jammer in a servo", _jammer("permanent_jammer", servo=True), 5.0),
    Kind("noise", _of_bus("noise", "noise", _BUS, 5e-5, 1e-3), 20.0, 10.0),
    Kind("loss on the bus", _of_bus("loss", "packet_loss", _BUS, 0.02, 0.1), 20.0, 10.0),
    Kind("loss of a servo", _of_servo("loss", "packet_loss", 0.05, 0.2), 30.0, 10.0),
    Kind("slow servo", _of_servo("slow", "slow_servo", 3e-4, 3e-3), 5.0),
    Kind("return delay", _return_delay, 35.0, least=3),
    Kind("undervoltage of a servo", _of_servo("undervoltage", "undervoltage", 6.0, 9.0)),
    Kind("low supply", _of_bus("undervoltage", "low_supply", _SUPPLY, 6.0, 9.0)),
    Kind("contact resistance", _resistance, 6.0, least=3, power=("adapter", "far")),
    Kind("overload", _of_servo("overload", "overload")),
    Kind("overheating", _of_servo("hardware_error", "overheating")),
    Kind("frozen values", _of_servo("frozen", "frozen_values"), moving=True),
    Kind("latency timer", _latency, 5.0),
    Kind("rhythmic jammer + break", _with_break("rhythmic_jammer"), 5.0, power=_NEAR, least=3),
    Kind("permanent jammer + break", _with_break("permanent_jammer"), 8.0, power=_NEAR, least=3),
    Kind("silent servo + break", _silent_and_break, 5.0, power=_NEAR, least=4),
    Kind("two loose contacts", _two_loose, 20.0, 10.0, least=4, from_trace=True),
)


def configuration(random: Random, kind: Kind) -> BusConfig:
    """A random bus."""
    return chain(
        random.randint(kind.least, 20),
        baud_rate=random.choice((1_000_000, 2_000_000, 3_000_000, 4_000_000)),
        rate=random.choice((50.0, 100.0, 200.0)),
        power=random.choice(kind.power),
        return_delay_us=random.choice((20, 100, 500)),
        fast_sync_read=random.random() < 0.5,
    )


def moving(config: BusConfig) -> Callable[[float], list[ServoGoal]]:
    """Goals of a robot that walks: torque on at the start, then every joint swings."""
    ids = config.ids()

    def goals(seconds: float) -> list[ServoGoal]:
        if seconds < 0.5:
            return [ServoGoal(id=servo_id, torque_enabled=True) for servo_id in ids]
        return [
            ServoGoal(id=servo_id, position=0.5 * math.sin(6.0 * seconds + servo_id))
            for servo_id in ids
        ]

    return goals


def scenario(kind: Kind, seed: str) -> Result:
    """Runs one."""
    random = Random(seed)
    config = configuration(random, kind)
    loss = random.choice(LOSSES)
    goals = moving(config) if kind.moving or random.random() < 0.5 else None
    rig = Rig(config, random.getrandbits(32), loss=loss, goals=goals)
    rig.run(WARM_UP_S + random.random())
    before = len(rig.reports)
    faults = kind.draw(random, config)
    begin_ns = EPOCH_NS + round(rig.seconds * 1e9)
    for fault in faults:
        rig.inject(fault.kind, fault.servo, fault.value)
    found: dict[str, float] = {}  # by truth: when it was rightly named
    if kind.from_trace:
        begin_ns = rig.run_until_missing(kind.limit_s)

    def all_found(report: FaultReport) -> bool:
        for fault in faults:
            if _fits(report, fault) and report.status == "active":
                found.setdefault(fault.truth, (report.stamp - begin_ns) / 1e9)
        return len(found) == len(faults)

    if rig.run_until(kind.limit_s, all_found) is not None:
        rig.run(SETTLE_S)
    active = rig.classifier.active()
    codes = {fault.code for fault in faults}
    exact = [any(r.component == f.truth and r.code == f.code for r in active) for f in faults]
    fits = [any(_fits(r, f) for r in active) for f in faults]
    wrong = [r.code for r in rig.reports[before:] if r.code not in codes]
    return Result(
        kind={report.code for report in active} == codes,
        place=all(fits),
        by_suspects=all(fits) and not all(exact),
        first=not wrong,
        took_s=max(found.values()) if len(found) == len(faults) else None,
        before=before,
        reported=wrong,
        seed=seed,
    )


def _fits(report: FaultReport, fault: Injected) -> bool:
    named = report.component == fault.truth or fault.truth in report.suspects
    return report.code == fault.code and named


def _numbered(job: tuple[int, str]) -> tuple[int, Result]:
    index, seed = job
    return index, scenario(KINDS[index], seed)


@dataclass(frozen=True)
class Healthy:
    """A bus without faults."""

    servos: int
    rate: float
    loss: float
    fast: bool
    moving: bool

    def __str__(self) -> str:
        read = "fast sync read" if self.fast else "sync read"
        motion = ", moving" if self.moving else ""
        return f"{self.servos} servos, {self.rate:g} Hz, {read}, loss {self.loss:.2%}{motion}"


HEALTHY: tuple[Healthy, ...] = (
    Healthy(20, 100.0, 1e-3, True, False),
    Healthy(20, 50.0, 1e-3, False, True),
    Healthy(12, 100.0, 5e-4, False, False),
    Healthy(4, 200.0, 1e-3, True, True),
)


def healthy(job: tuple[int, float, str]) -> tuple[int, int, list[str]]:
    """Runs traffic without faults: which, transactions, codes that were reported."""
    index, seconds, seed = job
    case = HEALTHY[index]
    config = chain(case.servos, rate=case.rate, fast_sync_read=case.fast, return_delay_us=20)
    goals = moving(config) if case.moving else None
    rig = Rig(config, Random(seed).getrandbits(32), loss=case.loss, goals=goals)
    rig.run(seconds)
    return index, rig.transactions, [r.code for r in rig.reports if r.status == "active"]


def run(
    *,
    quick: bool = False,
    scenarios: int | None = None,
    seeds: str = "judge",
    kinds: tuple[str, ...] = (),
    healthy_s: float | None = None,
) -> list[Table]:
    """All scenarios in two processes.

    Args:
        quick: A tenth of the scenarios and of the healthy hour.
        scenarios: Of each kind.
        seeds: ``judge`` or ``tune``.
        kinds: Beginnings of the names of rows; none: all.
        healthy_s: Length of the healthy traffic of each configuration.
    """
    count = scenarios if scenarios is not None else SCENARIOS // 10 if quick else SCENARIOS
    seconds = healthy_s if healthy_s is not None else HEALTHY_S / 10 if quick else HEALTHY_S
    chosen = [i for i, kind in enumerate(KINDS) if not kinds or kind.name.startswith(kinds)]
    jobs = [(index, f"{seeds}/{KINDS[index].name}/{n}") for index in chosen for n in range(count)]
    hours = [(index, seconds, f"{seeds}/healthy") for index in range(len(HEALTHY)) if seconds]
    results: dict[int, list[Result]] = {index: [] for index in chosen}
    with (
        multiprocessing.get_context("spawn").Pool(2) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        bar = progress.add_task("bus faults", total=len(jobs) + len(hours))
        quiet = list(_both(pool.imap_unordered(healthy, hours), progress, bar))
        for index, result in _both(pool.imap_unordered(_numbered, jobs, 4), progress, bar):
            results[index].append(result)
    return [_faults_table(results, seeds), _healthy_table(sorted(quiet), seconds)]


def _both(outcomes: Iterator, progress: Progress, bar: object) -> Iterator:  # type: ignore[type-arg]
    for outcome in outcomes:
        progress.advance(bar)  # type: ignore[arg-type]
        yield outcome


def _share(flags: list[bool]) -> str:
    return f"{100 * sum(flags) / len(flags):.1f}" if flags else ""


def _percentile(values: list[float], share: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)]


def _faults_table(results: dict[int, list[Result]], seeds: str) -> Table:
    table = Table(title=f"bus faults on the virtual bus, seeds {seeds!r}", title_justify="left")
    for heading in (
        "fault", "scenarios", "kind %", "place %", "by suspects %", "first right %",
        "p50 s", "p95 s", "aim s", "false before", "met",
    ):  # fmt: skip
        table.add_column(heading, justify="left" if heading == "fault" else "right")
    for index, rows in results.items():
        kind = KINDS[index]
        times = [row.took_s if row.took_s is not None else math.inf for row in rows]
        right = sum(row.kind for row in rows) / len(rows)
        placed = sum(row.place for row in rows) / len(rows)
        p95 = _percentile(times, 0.95)
        met = right >= 0.99 and placed >= 0.95 and p95 <= kind.aim_s
        table.add_row(
            kind.name,
            str(len(rows)),
            _share([row.kind for row in rows]),
            _share([row.place for row in rows]),
            _share([row.by_suspects for row in rows]),
            _share([row.first for row in rows]),
            f"{_percentile(times, 0.5):.2f}",
            f"{p95:.2f}",
            f"{kind.aim_s:g}",
            str(sum(row.before for row in rows)),
            "[green]yes" if met else "[red]NO",
        )
    return table


def _healthy_table(rows: list[tuple[int, int, list[str]]], seconds: float) -> Table:
    table = Table(title=f"healthy traffic, {seconds / 60:g} min each", title_justify="left")
    for heading in ("bus", "transactions", "false alarms", "which"):
        table.add_column(heading, justify="right" if heading.endswith("s") else "left")
    for index, transactions, codes in rows:
        table.add_row(
            str(HEALTHY[index]), str(transactions), str(len(codes)), ", ".join(sorted(set(codes)))
        )
    return table
