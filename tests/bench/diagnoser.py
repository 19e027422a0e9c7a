"""Diagnoser: cost of a step, and how well faults of simulated robots are named.

Each robot has its own build, calibration errors, gyro, path and noise from its seed. It
drives for half a minute without a fault, in which every report is a false alarm; then each kind of
fault befalls a copy of it. No robot was known while thresholds were chosen
(:mod:`tests.bench.fresh`).

Named: at the end of the run the faulty components, and no others, are reported. Kind: and as the
right kind, sensor or actuator, or the right row of the paper's table 1; of a steering half a degree
off it is right to say that this motion does not tell. Times count from the fault, whether it could
show by then or not; what is a share of a wheel's speed is watched until that has been told to roll.
The paper: the component that its Steps I to IV name most often in the same run. A row that is near
its aim takes more robots: :mod:`tests.bench.one_kind`.
"""

# ruff: noqa: E402
import copy
import math
import multiprocessing
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import cycle, islice
from random import Random

from wackel_node.algebra import single_threaded

single_threaded()  # as the service does

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.bench.fresh import version
from tests.bench.result import Figure, Prepared, side_by_side, table
from tests.diagnoser.fleet import COMPLAINTS
from tests.diagnoser.rig import SHORT_WARM_UP_S, WARM_UP_S, Rig
from tests.odometry.simulation import differential_drive, steered_drive
from wackel_diagnoser.core import Diagnoser
from wackel_drive.layout import Layout
from wackel_kinematics.candidates import Candidates
from wackel_kinematics.forward import least_squares
from wackel_kinematics.inverse import inverse
from wackel_node.config_drive import DriveConfig, GyroConfig
from wackel_node.garbage import collect_rarely
from wackel_schemas import component
from wackel_schemas.residuals import Residuals
from wackel_virtual.build import Build
from wackel_virtual.drive_simulation import Cycle
from wackel_virtual.drivetrain import Physics

ROBOTS = 100
SETTLE_S = 2.5
STANDS_S = 0.1
"""For how long a wheel that sticks now and then must have stood while it was told to roll faster
than :data:`TOLD_M_S`; before that nothing has happened."""
TOLD_M_S = 0.1
ROLLS_M = 0.5
"""How far a wheel must have been told to roll to show what is a share of its speed: a tenth of that
is a gap of 5 cm, and a tenth of nothing is nothing."""
LONGEST_S = 10.0
"""But it is watched no longer."""
SMALL_S = 15.0
"""For how long the smallest faults that count are watched."""
FREE_S = 2.0
"""The same of wheels that roll freely."""
ABRUPT_S = 0.05
"""In which abrupt faults are to be seen, median."""
STUCK_S = 0.1
"""And what is stuck, from when it is off by DEVIATES of the speed, or DEVIATES_RAD."""
DEVIATES, DEVIATES_RAD = 0.05, math.radians(1.0)
LEAST_M_S, LEAST_RAD_S = 0.005, 0.02
"""But at least by this: five hundredths of hardly any speed are what encoders round."""

NAMED = 0.995
"""Of single faults, the share whose component is to be named; less where a row says so."""
TOLD = 0.98
"""Of these, the share of which it is to be told rightly whether sensor or actuator is at fault."""
DOUBLE = {3: 0.9, 4: 0.95}
"""The same of two faults at once, by the number of wheels."""

SIZED = ("_offset", "_scale")
"""Ends of the kinds that have a strength, where they come with another."""
NOWHERE = ("gyro", "push")
"""Beginnings of those that are of no wheel."""

STEP_US = {"4 steered wheels": 150.0, "8 steered wheels": 400.0}
"""Budgets of a step."""
STEP_BY_PEER = 3.5
"""The first of them by its peer, which takes 43 µs with Debian's Python while nothing else keeps
the computer busy: what is missed here but not there, is missed by the computer or its Python. One
that was built without optimisation makes both slower alike, by an eighth; so do others that use the
computer's memory, though the step, which needs more of it, a little more."""


NO_PARTS = (component.DRIVE, component.COMMAND)
"""What is reported where something is wrong that no part can be accused of."""


@dataclass(frozen=True)
class Kind:
    """A row of the table.

    Attributes:
        name: Of the row.
        faults: Kinds of the simulation, and which fault codes are right; two for a double fault.
        value: Draws a strength.
        fault: The class, for the paper; empty where it is not asked.
        lasts_s: How long it is watched at least.
        rolls_m: How far its wheel must have been told to roll meanwhile.
        stands_s: For how long it must have stood instead.
        named: The share of runs in which it should be named; 0: none is aimed at.
        named_by: The same by the number of wheels.
        first_s: Time to the first report that is aimed at, median; 0: none.
        after_s: The same from when the fault first shows, see :func:`_deviates`.
        untold: Why it cannot be told; empty where it can.
        one_wheel: Both befall the same.
    """

    name: str
    faults: tuple[tuple[str, tuple[str, ...]], ...]
    value: Callable[[Random], float | None] = lambda _: None
    fault: str = ""
    lasts_s: float = SETTLE_S
    rolls_m: float = 0.0
    stands_s: float = 0.0
    named: float = NAMED
    named_by: Mapping[int, float] = field(default_factory=dict)
    first_s: float = 0.0
    after_s: float = 0.0
    untold: str = ""
    one_wheel: bool = False

    def aim(self, wheels: int) -> float:
        """The share that should be named of robots with so many wheels."""
        return self.named_by.get(wheels, self.named)


def _either_way(least: float, most: float) -> Callable[[Random], float]:
    return lambda random: random.choice((-1, 1)) * random.uniform(least, most)


def _between(least: float, most: float) -> Callable[[Random], float]:
    return lambda random: random.uniform(least, most)


KINDS = (
    Kind(
        "wheel blocked",
        (("wheel_blocked", ("wheel_blocked",)),),
        fault="actuator",
        first_s=ABRUPT_S,
    ),
    Kind(
        "wheel sticks",
        (("wheel_temporarily_blocked", ("wheel_sticks", "wheel_blocked")),),
        _between(0.3, 0.9),
        "actuator",
        rolls_m=ROLLS_M,
        stands_s=STANDS_S,
        after_s=STUCK_S,
    ),
    Kind(
        "wheel free, torque off",
        (("wheel_free", ("wheel_free",)),),
        fault="actuator",
        lasts_s=FREE_S,
        named=0.95,
    ),
    Kind("wheel off its motor", (("wheel_loose", ("wheel_free",)),), lasts_s=FREE_S, named=0.95),
    Kind(
        "motor 10 to 50 % wrong",
        (("drive_scale", ("wheel_deviates",)),),
        _either_way(0.1, 0.5),
        "actuator",
        rolls_m=ROLLS_M,
    ),
    Kind(
        "steering blocked",
        (("steering_blocked", ("steering_blocked",)),),
        fault="actuator",
        after_s=STUCK_S,
    ),
    Kind(
        "steering 3° to 15° off",
        (("steering_offset", ("steering_offset", "steering_blocked")),),
        _either_way(math.radians(3), math.radians(15)),
        "actuator",
    ),
    Kind(
        "zero of steering 5° to 15° wrong",
        (("steering_reference_error", ("steering_reference",)),),
        _either_way(math.radians(5), math.radians(15)),
        lasts_s=20.0,
        named_by={3: 0.9, 4: 0.7},
    ),
    Kind(
        "drive sensor stuck",
        (("drive_sensor_stuck", ("wheel_sensor",)),),
        fault="sensor",
        after_s=STUCK_S,
    ),
    Kind(
        "drive sensor 10 to 50 % wrong",
        (("drive_sensor_scale", ("wheel_sensor",)),),
        _either_way(0.1, 0.5),
        "sensor",
        rolls_m=ROLLS_M,
        first_s=ABRUPT_S,
    ),
    Kind(
        "steering sensor stuck",
        (("steering_sensor_stuck", ("steering_sensor",)),),
        fault="sensor",
        after_s=STUCK_S,
    ),
    Kind(
        "steering sensor 3° to 15° off",
        (("steering_sensor_offset", ("steering_sensor",)),),
        _either_way(math.radians(3), math.radians(15)),
        "sensor",
        first_s=ABRUPT_S,
    ),
    Kind(
        "gyro jumps by 0.05 to 0.3 rad/s",
        (("gyro_offset", ("gyro_deviates",)),),
        _either_way(0.05, 0.3),
        first_s=ABRUPT_S,
    ),
    Kind("gyro frozen", (("gyro_frozen", ("gyro_deviates",)),), after_s=STUCK_S),
    *(
        Kind(
            name,
            tuple(zip(faults, codes, strict=True)),
            _either_way(0.1, 0.25),  # of those that have a size: a share, or rad
            named_by=DOUBLE,
        )
        for name, faults, codes in (
            ("two wheels blocked", ("wheel_blocked",) * 2, (("wheel_blocked",),) * 2),
            (
                "wheel blocked, steering sensor stuck",
                ("wheel_blocked", "steering_sensor_stuck"),
                (("wheel_blocked",), ("steering_sensor", "steering_blocked")),
            ),
            (
                "wheel blocked, steering off",
                ("wheel_blocked", "steering_offset"),
                (("wheel_blocked",), ("steering_offset", "steering_blocked")),
            ),
            (
                "two steerings blocked",
                ("steering_blocked",) * 2,
                (("steering_blocked",),) * 2,
            ),
            (
                "two steerings off",
                ("steering_offset",) * 2,
                (("steering_offset", "steering_blocked"),) * 2,
            ),
            ("two drive sensors stuck", ("drive_sensor_stuck",) * 2, (("wheel_sensor",),) * 2),
            (
                "drive sensor and steering sensor stuck",
                ("drive_sensor_stuck", "steering_sensor_stuck"),
                (("wheel_sensor",), ("steering_sensor",)),
            ),
        )
    ),
    Kind(
        "motor wrong, other steering off",
        (("drive_scale", ("wheel_deviates",)), ("steering_offset", ("steering_offset",))),
        _either_way(0.1, 0.25),
        named=0.0,
        untold="what a wheel that stands off makes the others slip hides a motor that still rolls "
        "about as it is told, until the first is repaired",
    ),
    Kind(
        "wheel blocked, gyro jumps",
        (("wheel_blocked", ("wheel_blocked",)), ("gyro_offset", ("gyro_deviates",))),
        _either_way(0.1, 0.25),
        named=0.0,
        untold="a wheel that is dragged turns the robot by as much, until it is repaired",
    ),
    Kind(
        "wheel blocked and its own steering sensor stuck",
        (("wheel_blocked", ("wheel_blocked",)), ("steering_sensor_stuck", ("steering_sensor",))),
        named=0.0,
        untold="a wheel whose direction is not known has no measurement left that would tell of "
        "another fault of it, until the first is repaired",
        one_wheel=True,
    ),
    Kind(
        "push",
        (("push", ("drive_disturbed",)),),
        _between(0.5, 2.0),
        lasts_s=0.6,
        named=0.0,
        untold="tyres bear the weaker ones, so that nothing moves that is measured",
    ),
    Kind(
        "ice under a wheel",
        (("ice_patch", ("drive_disturbed",)),),
        named=0.0,
        untold="the other wheels hold the robot on its way; only the motor of the one on ice "
        "eases, and to be sure of that takes longer than a patch lasts",
    ),
    Kind(
        "motor 3 % wrong",
        (("drive_scale", ("wheel_deviates",)),),
        _either_way(0.03, 0.03),
        "actuator",
        lasts_s=SMALL_S,
        named=0.95,
    ),
    Kind(
        "drive sensor 3 % wrong",
        (("drive_sensor_scale", ("wheel_sensor",)),),
        _either_way(0.03, 0.03),
        "sensor",
        lasts_s=SMALL_S,
        named=0.95,
    ),
    Kind(
        "steering 0.5° off",
        (("steering_offset", ("steering_deviates", "steering_offset", "steering_blocked")),),
        _either_way(math.radians(0.5), math.radians(0.5)),
        "actuator",
        lasts_s=SMALL_S,
        named=0.95,
    ),
    Kind(
        "steering sensor 0.5° off",
        (("steering_sensor_offset", ("steering_deviates", "steering_sensor")),),
        _either_way(math.radians(0.5), math.radians(0.5)),
        "sensor",
        lasts_s=SMALL_S,
        named=0.95,
    ),
    Kind(
        "gyro jumps by 0.02 rad/s",
        (("gyro_offset", ("gyro_deviates",)),),
        _either_way(0.02, 0.02),
        lasts_s=SMALL_S,
        named=0.95,
    ),
)


@dataclass(frozen=True)
class Outcome:
    """One fault of one robot.

    Attributes:
        kind: Number of the row.
        first_s: Time to the first report; ``None``: there was none.
        after_s: The same since the fault first showed, see :func:`_deviates`.
        first: It named a faulty component.
        named: As above.
        wrong: Another part was named at the end.
        code: As above.
        by_paper, by_paper_kind: What the paper's steps named.
    """

    kind: int
    first_s: float | None
    after_s: float | None
    first: bool
    named: bool
    wrong: bool
    code: bool
    by_paper: bool
    by_paper_kind: bool


@dataclass(frozen=True)
class Robot:
    """One robot of the tables.

    Attributes:
        outcomes: Of each fault.
        healthy_s: Driving without a fault.
        alarms: Reports meanwhile.
        paper_s: Time of it in which the paper's steps named something.
    """

    outcomes: list[Outcome]
    healthy_s: float
    alarms: list[str]
    paper_s: float


def robot(job: tuple[int, Physics, str]) -> Robot:
    """Half a minute without a fault, then each fault."""
    wheels, physics, seed = job
    rig = Rig.of(seed, wheels, physics=physics, build=Build.drawn(Random(f"{seed}/build")))
    paper = 0
    for _ in range(round(WARM_UP_S * 10)):
        rig.drive(0.1)
        paper += bool(_paper(rig.residuals)[0])
    outcomes = [befall(rig.copy(), number, seed) for number in range(len(KINDS))]
    alarms = [report.code for report in rig.reports if report.status == "active"]
    return Robot(outcomes, WARM_UP_S, alarms, 0.1 * paper)


def befall(rig: Rig, number: int, seed: str) -> Outcome:
    """A kind of fault befalls a robot."""
    kind = KINDS[number]
    random = Random(f"{seed}/{kind.name}")
    rig.drive(random.uniform(0.0, 2.0))
    rig.reports.clear()
    begin = rig.now_ns
    names = [wheel.name for wheel in rig.config.wheels]
    wheels = random.sample(having(rig.config, kind), len(kind.faults))
    if kind.one_wheel:
        wheels = wheels[:1] * 2
    sound = copy.deepcopy(rig.simulation)
    right: dict[str, tuple[str, ...]] = {}
    for (fault, codes), wheel in zip(kind.faults, wheels, strict=True):
        value = kind.value(random) if len(wheels) == 1 or fault.endswith(SIZED) else None
        rig.inject(fault, None if fault.startswith(NOWHERE) else names[wheel], value)
        right[_component(fault, names[wheel])] = codes
    votes: Counter[tuple[tuple[str, ...], str]] = Counter()
    rolled_m = stood_s = 0.0
    deviates_ns: int | None = None
    tenths, place = 0, Layout(rig.config).drive.xy[wheels[0]].tolist()
    while tenths < 10 * kind.lasts_s or (
        (rolled_m < kind.rolls_m or stood_s < kind.stands_s) and tenths < 10 * LONGEST_S
    ):
        for _ in range(10):
            twist, told = rig.path[rig.cycles % len(rig.path)], _told(rig, place)
            cycle = rig.cycle()
            rolled_m += 0.01 * told
            stood_s += 0.01 * bool(told > TOLD_M_S and rig.simulation.blocked[wheels[0]])
            if (
                kind.after_s
                and deviates_ns is None
                and _deviates(rig.config, cycle, sound.step(*twist.tolist()))
            ):
                deviates_ns = cycle.state.stamp
        tenths += 1
        votes[_paper(rig.residuals)] += 1
    started = [
        report
        for report in rig.reports
        if report.status == "active" and report.code not in COMPLAINTS
    ]
    final = [(code, path) for code, path in rig.active() if code not in COMPLAINTS]
    if set(right) == {component.DRIVE}:  # what passes by itself counts if it was named at all
        final = [(report.code, report.component) for report in started]
    named = {path for _, path in final} == set(right)
    first_ns = started[0].stamp if started else None
    votes.pop(((), ""), None)
    by_paper, fault = votes.most_common(1)[0][0] if votes else ((), "")
    return Outcome(
        number,
        (first_ns - begin) / 1e9 if first_ns else None,
        max(first_ns - deviates_ns, 0) / 1e9 if first_ns and deviates_ns else None,
        bool(started) and started[0].component in right,
        named,
        bool({path for _, path in final} - {*right, *NO_PARTS}),
        named and all(code in right[path] for code, path in final),
        set(by_paper) == set(right),
        set(by_paper) == set(right) and fault == kind.fault,
    )


def having(drive: DriveConfig, kind: Kind) -> list[int]:
    """Wheels that have the parts which faults of a kind concern."""
    steerings = any(fault.startswith("steering") for fault, _ in kind.faults)
    drives = not all(fault.startswith("steering") for fault, _ in kind.faults)
    return [
        i
        for i, wheel in enumerate(drive.wheels)
        if not (steerings and wheel.steering is None) and not (drives and wheel.drive is None)
    ]


def _component(fault: str, wheel: str) -> str:
    """What a kind of the simulation makes faulty."""
    if fault in ("push", "ice_patch"):
        return component.DRIVE
    if fault.startswith("gyro"):
        return component.gyro("body")
    return (component.wheel_steering if fault.startswith("steering") else component.wheel_drive)(
        wheel
    )


def _deviates(config: DriveConfig, cycle: Cycle, sound: Cycle) -> bool:
    """Whether a robot shows something else than it would without its fault."""
    now, should = ({servo.id: servo for servo in each.state.servos} for each in (cycle, sound))
    for wheel in config.wheels:
        if wheel.drive is not None:
            speeds = [
                (servos[wheel.drive].velocity or 0.0) * wheel.radius for servos in (now, should)
            ]
            if abs(speeds[0] - speeds[1]) > max(DEVIATES * abs(speeds[1]), LEAST_M_S):
                return True
        if wheel.steering is not None:
            angle, straight = (servos[wheel.steering].position or 0.0 for servos in (now, should))
            if abs(angle - straight) > DEVIATES_RAD:
                return True
    turns, turned = cycle.imu.angular_velocity[2], sound.imu.angular_velocity[2]
    return abs(turns - turned) > max(DEVIATES * abs(turned), LEAST_RAD_S)


def _told(rig: Rig, place: tuple[float, float]) -> float:
    """Speed at which a wheel at a place, m, is told to roll now, m/s."""
    vx, vy, omega = rig.path[rig.cycles % len(rig.path)].tolist()
    x, y = place
    return math.hypot(vx - omega * y, vy + omega * x)


def _paper(residuals: Residuals | None) -> tuple[tuple[str, ...], str]:
    """Components and class that the paper's steps name."""
    if residuals is None:
        return (), ""
    steps = {step.step: step for step in residuals.steps}
    found = steps.get("III")
    components = tuple(found.components) if found is not None else ()
    fourth = steps.get("IV")
    fault = ""
    if fourth is not None and components:
        fault = "sensor" if "sensor is wrong" in fourth.text else "actuator"
    return components, fault


def run(
    *,
    quick: bool = False,
    robots: int | None = None,
    mujoco: int | None = None,
    seeds: str | None = None,
) -> list[Table]:
    """Cost, then all robots in two processes.

    Args:
        quick: A few robots.
        robots: Of each number of wheels, in the fast simulation.
        mujoco: The same with contact physics.
        seeds: Beginning of those of the robots; else they are fresh.
    """
    seeds = seeds or version()
    count = robots if robots is not None else 4 if quick else ROBOTS
    touching = mujoco if mujoco is not None else 1 if quick else ROBOTS
    counts: list[tuple[Physics, int]] = [("fast", count), ("mujoco", touching)]
    sets = [(wheels, physics, many) for physics, many in counts if many for wheels in (3, 4)]
    tables = _cost(quick)
    with (
        multiprocessing.get_context("spawn").Pool(2) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        for wheels, physics, many in sets:
            jobs = [(wheels, physics, f"{seeds}/{physics}/{wheels}/{i}") for i in range(many)]
            bar = progress.add_task(f"{wheels} wheels, {physics}", total=many)
            found = []
            for each in pool.imap_unordered(robot, jobs):
                found.append(each)
                progress.advance(bar)
            tables.append(_faults_table(found, wheels, f"{physics}, {seeds!r}"))
    return tables


def fault_columns(title: str) -> Table:
    """An empty table of kinds of faults."""
    shown = Table(title=title, title_justify="left")
    for heading in (
        "fault", "seen %", "first right %", "named %", "kind %", "p50 s", "p95 s",
        "after p50 s", "after p95 s", "paper: named %", "paper: kind %", "met",
    ):  # fmt: skip
        shown.add_column(heading, justify="left" if heading == "fault" else "right")
    return shown


def fault_row(kind: Kind, rows: list[Outcome], wheels: int) -> list[str]:
    """Its line in the table.

    Args:
        kind: Of fault.
        rows: What became of it, at least one.
        wheels: Of the robots.
    """
    median, late = _quantiles([row.first_s for row in rows])
    after, late_after = _quantiles([row.after_s for row in rows])
    named = sum(row.named for row in rows) / len(rows)
    aim = kind.aim(wheels)
    met = (
        named >= aim
        and (not kind.first_s or median <= kind.first_s)
        and (not kind.after_s or after <= kind.after_s)
    )
    return [
        kind.name,
        _share([row.first_s is not None for row in rows]),
        _share([row.first for row in rows]),
        _share([row.named for row in rows]),
        _share([row.code for row in rows]),
        f"{median:.2f}",
        f"{late:.2f}",
        f"{after:.2f}" if kind.after_s else "",
        f"{late_after:.2f}" if kind.after_s else "",
        _share([row.by_paper for row in rows]),
        _share([row.by_paper_kind for row in rows]) if kind.fault else "",
        {True: "[green]yes", False: "[red]NO"}[met] if aim else kind.untold and "cannot",
    ]


def _faults_table(robots: list[Robot], wheels: int, title: str) -> Table:
    title = f"Diagnoser: {wheels} steered wheels, {title}, {len(robots)} robots"
    shown = fault_columns(title)
    for number, kind in enumerate(KINDS):
        rows = [row for robot in robots for row in robot.outcomes if row.kind == number]
        shown.add_row(*fault_row(kind, rows, wheels))
    shown.add_section()
    for row in _totals(robots, wheels):
        shown.add_row(*row)
    hours = sum(robot.healthy_s for robot in robots) / 3600
    alarms = Counter(code for robot in robots for code in robot.alarms)
    said = ", ".join(f"{count} {code}" for code, count in alarms.items()) or "none"
    wrong = sum(robot.paper_s for robot in robots) / 36 / hours
    shown.caption = (
        f"false alarms before the faults, in {hours:.2f} h: {said}; the paper's steps name "
        f"something in {wrong:.1f} % of that time"
    )
    for kind in KINDS:
        if kind.untold:
            shown.caption += f"\n{kind.name} cannot be told: {kind.untold}"
    return shown


def named_table(title: str, found: Mapping[str, list[Outcome]], numbers: list[int]) -> Table:
    """How often faults were named, and another part was.

    Args:
        title: Of the table.
        found: Outcomes by column.
        numbers: Of the rows.
    """
    title = (
        f"{title}, named % / another part named %; else only that something is wrong, or nothing"
    )
    shown = Table(title=title, title_justify="left")
    shown.add_column("fault")
    for column in found:
        shown.add_column(column, justify="right")
    for number in numbers:
        rows = [[row for row in each if row.kind == number] for each in found.values()]
        cells = [
            f"{_share([row.named for row in each])} / {_share([row.wrong for row in each])}"
            if each
            else ""
            for each in rows
        ]
        shown.add_row(KINDS[number].name, *cells)
    return shown


def _totals(robots: list[Robot], wheels: int) -> list[list[str]]:
    """Rows of what is aimed at for all faults of a sort together."""
    every = [(KINDS[row.kind], row) for robot in robots for row in robot.outcomes]
    single = [row for kind, row in every if kind.aim(wheels) == NAMED]
    either = [row for kind, row in every if kind.aim(wheels) == NAMED and kind.fault]
    double = [row for kind, row in every if kind.named_by == DOUBLE]
    sorts = (
        (f"the single ones that aim at {NAMED:.1%}", single, "named", NAMED),
        ("of these, sensor or actuator", either, "code", TOLD),
        ("two at once", double, "named", DOUBLE[wheels]),
    )
    shown = []
    for name, rows, attribute, aim in sorts:
        share = sum(getattr(row, attribute) for row in rows) / len(rows)
        met = "[green]yes" if share >= aim else "[red]NO"
        place = 3 if attribute == "named" else 4  # the column's
        shown.append([name, *[""] * (place - 1), f"{100 * share:.2f}", *[""] * (10 - place), met])
    return shown


def _quantiles(times: list[float | None]) -> tuple[float, float]:
    """Median and 95 %, s; what was not seen took for ever."""
    ordered = sorted(math.inf if each is None else each for each in times)
    return ordered[(len(ordered) - 1) // 2], ordered[math.ceil(0.95 * len(ordered)) - 1]


def _share(flags: list[bool]) -> str:
    return f"{100 * sum(flags) / len(flags):.1f}"


def _cost(quick: bool) -> list[Table]:
    """CPU time from the messages of a cycle to the conclusions, beside the least arithmetic."""
    drives = {
        "2 fixed wheels": differential_drive(),
        **{f"{n} steered wheels": steered_drive(n) for n in (3, 4, 6, 8)},
    }
    # Of a turn, the first steps find the processor's memory full of what had the turn before. In
    # turns of 50 steps that is a twentieth of what is measured, and none of it is the step's.
    rounds, calls = 5 if quick else 20, 400
    actions = [_cycles(config) for config in drives.values()]
    of_four, of_eight = STEP_US
    alone = _cycles(drives[of_four], shown=False)
    faulty = _cycles(drives[of_four], shown=False, blocked=True)
    collect_rarely()  # as the service does
    *figures, unseen, named, bare = side_by_side(
        *actions, alone, faulty, _bare(4), rounds=rounds, calls=calls, cpu=True
    )
    by_name = dict(zip(drives, figures, strict=True))
    four, peer = by_name[of_four], ("least squares, candidates", bare)
    return [
        table(
            "Diagnoser: CPU of a step with a gyro and a new command",
            [
                Figure(name, figure, "µs", None, STEP_US.get(name))
                for name, figure in by_name.items()
            ]
            + [
                Figure(f"{of_four}, by their peer", four, "µs", peer, STEP_BY_PEER),
                Figure(f"{of_four}, nobody looks", unseen, "µs", None, STEP_US[of_four]),
                Figure(f"{of_four}, a wheel blocked", named, "µs", None, STEP_US[of_four]),
                Figure("8 wheels by 4", by_name[of_eight] / four, ""),
            ],
        )
    ]


def _cycles(config: DriveConfig, *, shown: bool = True, blocked: bool = False) -> Prepared[Cycle]:
    """Cycles of a robot that drives; none twice: where the robot would jump back, there would be
    something to diagnose.

    Args:
        config: Of the robot.
        shown: Whether somebody looks at residuals.
        blocked: Whether a wheel is, and has been named.
    """
    rig = Rig.of("cost", config)
    path = cycle(rig.path.tolist())
    diagnoser = Diagnoser(config, {"body": GyroConfig()}, lambda: shown)

    def drive(count: int) -> list[Cycle]:
        return [rig.simulation.step(*twist) for twist in islice(path, count)]

    def diagnose(each: Cycle) -> None:
        diagnoser.command(each.command)
        diagnoser.imu("body", each.imu)
        diagnoser.bus_state(rig.simulation.bus, each.state)

    if blocked:
        for each in drive(round(100 * SHORT_WARM_UP_S)):
            diagnose(each)
        rig.inject("wheel_blocked", config.wheels[0].name)
        for each in drive(100):
            diagnose(each)
        if not diagnoser.active():
            raise SystemExit("the wheel that is blocked has not been named")
    return Prepared(drive, diagnose)


def _bare(wheels: int) -> Callable[[], object]:
    """The least that any such diagnosis computes: forward kinematics and the candidates."""
    drive = Layout(steered_drive(wheels)).drive
    candidates = Candidates(drive)
    motion = inverse(drive, np.array([0.5, 0.1, 0.3]), drive.steering(np.zeros(wheels)))

    def step() -> None:
        rows, values = drive.rows(motion.steering), drive.values(motion.wheel_rate)
        least_squares(rows, values, drive.length_m)
        candidates.twists(rows, values)

    return step
