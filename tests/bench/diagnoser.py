"""Diagnoser: cost of a step, and how well faults of simulated robots are named.

Each robot has its own build, calibration errors, gyro, path and noise from its seed. It
drives for half a minute without a fault, in which every report is a false alarm; then each kind of
fault befalls a copy of it. The seeds of ``tune`` were used while thresholds were chosen; those of
``judge``, which this prints, were not.

Named: at the end of the run the faulty components, and no others, are reported. Kind: and as the
right kind, sensor or actuator, or the right row of the paper's table 1; of a steering half a degree
off it is right to say that this motion does not tell. Times count from the fault, whether it could
show by then or not; what is a share of a wheel's speed is watched until that has been told to roll.
The paper: the component that its Steps I to IV name most often in the same run.
"""

# ruff: noqa: E402
import math
import multiprocessing
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import cycle, islice
from random import Random
from typing import Literal

from wackel_node.algebra import single_threaded

single_threaded()  # as the service does

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.bench.result import Figure, Prepared, side_by_side, table
from tests.diagnoser.rig import WARM_UP_S, Rig
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

COMPLAINTS = ("command_infeasible", "command_singular")
"""Of the command, which is as it is: no faults of the robot."""

NAMED = 0.995
"""Of single faults, the share whose component is to be named; less where a row says so."""
TOLD = 0.98
"""Of these, the share of which it is to be told rightly whether sensor or actuator is at fault."""
DOUBLE = {3: 0.9, 4: 0.95}
"""The same of two faults at once, by the number of wheels."""

STEP_US = {"4 steered wheels": 150.0, "8 steered wheels": 400.0}
"""Budgets of a step."""
STEP_BY_PEER = 3.5
"""The first of them by its peer, which takes 43 µs with Debian's Python while nothing else keeps
the computer busy: what is missed here but not there, is missed by the computer or its Python. One
that was built without optimisation makes both slower alike, by an eighth; so do others that use the
computer's memory, though the step, which needs more of it, a little more."""

Physics = Literal["fast", "mujoco"]


@dataclass(frozen=True)
class Kind:
    """A row of the table.

    Attributes:
        name: Of the row.
        faults: Kinds of the simulation; two for a double fault.
        value: Draws a strength.
        codes: Which of the fault codes are right.
        fault: The class, for the paper; empty where it is not asked.
        lasts_s: How long it is watched at least.
        rolls_m: How far its wheel must have been told to roll meanwhile.
        stands_s: For how long it must have stood instead.
        named: The share of runs in which it should be named; 0: none is aimed at.
        first_s: Time to the first report that is aimed at, median; 0: none.
        untold: Why it cannot be told; empty where it can.
    """

    name: str
    faults: tuple[str, ...]
    codes: tuple[str, ...]
    value: Callable[[Random], float | None] = lambda _: None
    fault: str = ""
    lasts_s: float = SETTLE_S
    rolls_m: float = 0.0
    stands_s: float = 0.0
    named: float = NAMED
    first_s: float = 0.0
    untold: str = ""


def _either_way(least: float, most: float) -> Callable[[Random], float]:
    return lambda random: random.choice((-1, 1)) * random.uniform(least, most)


def _between(least: float, most: float) -> Callable[[Random], float]:
    return lambda random: random.uniform(least, most)


KINDS = (
    Kind("wheel blocked", ("wheel_blocked",), ("wheel_blocked",), fault="actuator", first_s=0.05),
    Kind(
        "wheel sticks",
        ("wheel_temporarily_blocked",),
        ("wheel_sticks", "wheel_blocked"),
        _between(0.3, 0.9),
        "actuator",
        rolls_m=ROLLS_M,
        stands_s=STANDS_S,
    ),
    Kind("wheel free, torque off", ("wheel_free",), ("wheel_free",), fault="actuator"),
    Kind("wheel off its motor", ("wheel_loose",), ("wheel_free",), lasts_s=5.0, named=0.95),
    Kind(
        "motor 10 to 50 % wrong",
        ("drive_scale",),
        ("wheel_deviates",),
        _either_way(0.1, 0.5),
        "actuator",
        rolls_m=ROLLS_M,
    ),
    Kind("steering blocked", ("steering_blocked",), ("steering_blocked",), fault="actuator"),
    Kind(
        "steering 3° to 15° off",
        ("steering_offset",),
        ("steering_offset", "steering_blocked"),
        _either_way(math.radians(3), math.radians(15)),
        "actuator",
    ),
    Kind(
        "zero of steering 5° to 15° wrong",
        ("steering_reference_error",),
        ("steering_reference",),
        _either_way(math.radians(5), math.radians(15)),
        lasts_s=20.0,
        named=0.7,  # and 0.9 with three wheels
    ),
    Kind(
        "drive sensor stuck",
        ("drive_sensor_stuck",),
        ("wheel_sensor",),
        fault="sensor",
        first_s=0.05,
    ),
    Kind(
        "drive sensor 10 to 50 % wrong",
        ("drive_sensor_scale",),
        ("wheel_sensor",),
        _either_way(0.1, 0.5),
        "sensor",
        rolls_m=ROLLS_M,
        first_s=0.05,
    ),
    Kind(
        "steering sensor stuck",
        ("steering_sensor_stuck",),
        ("steering_sensor",),
        fault="sensor",
    ),
    Kind(
        "steering sensor 3° to 15° off",
        ("steering_sensor_offset",),
        ("steering_sensor",),
        _either_way(math.radians(3), math.radians(15)),
        "sensor",
    ),
    Kind(
        "gyro jumps by 0.05 to 0.3 rad/s",
        ("gyro_offset",),
        ("gyro_deviates",),
        _either_way(0.05, 0.3),
        first_s=0.05,
    ),
    Kind("gyro frozen", ("gyro_frozen",), ("gyro_deviates",)),
    Kind(
        "two wheels blocked",
        ("wheel_blocked", "wheel_blocked"),
        ("two_faults", "wheel_blocked"),
        named=0.95,
    ),
    Kind(
        "wheel blocked, steering sensor stuck",
        ("wheel_blocked", "steering_sensor_stuck"),
        ("two_faults",),
        named=0.95,
    ),
    Kind(
        "two drive sensors stuck",
        ("drive_sensor_stuck", "drive_sensor_stuck"),
        ("two_faults",),
        named=0.95,
    ),
    Kind("push", ("push",), ("drive_disturbed",), _between(0.5, 2.0), lasts_s=0.6, named=0.0),
    Kind(
        "ice under a wheel",
        ("ice_patch",),
        ("drive_disturbed",),
        named=0.0,
        untold="the other wheels hold the robot on its way; only the motor of the one on ice "
        "eases, and to be sure of that takes longer than a patch lasts",
    ),
    Kind(
        "motor 3 % wrong",
        ("drive_scale",),
        ("wheel_deviates",),
        _either_way(0.03, 0.03),
        "actuator",
        lasts_s=SMALL_S,
        named=0.95,
    ),
    Kind(
        "drive sensor 3 % wrong",
        ("drive_sensor_scale",),
        ("wheel_sensor",),
        _either_way(0.03, 0.03),
        "sensor",
        lasts_s=SMALL_S,
        named=0.95,
    ),
    Kind(
        "steering 0.5° off",
        ("steering_offset",),
        ("steering_deviates", "steering_offset", "steering_blocked"),
        _either_way(math.radians(0.5), math.radians(0.5)),
        "actuator",
        lasts_s=SMALL_S,
        named=0.95,
    ),
    Kind(
        "steering sensor 0.5° off",
        ("steering_sensor_offset",),
        ("steering_deviates", "steering_sensor"),
        _either_way(math.radians(0.5), math.radians(0.5)),
        "sensor",
        lasts_s=SMALL_S,
        named=0.95,
    ),
    Kind(
        "gyro jumps by 0.02 rad/s",
        ("gyro_offset",),
        ("gyro_deviates",),
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
        first: It named a faulty component.
        named: As above.
        wrong: Another part was named at the end.
        code: As above.
        by_paper, by_paper_kind: What the paper's steps named.
    """

    kind: int
    first_s: float | None
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
    true = set()
    for fault, wheel in zip(kind.faults, wheels, strict=True):
        part = "steering" if fault.startswith("steering") else "drive"
        if fault.startswith("gyro"):
            rig.inject(fault, value=kind.value(random))
            true.add(component.gyro("body"))
        elif fault == "push":
            rig.inject(fault, value=kind.value(random))
            true.add(component.DRIVE)
        else:
            rig.inject(fault, names[wheel], kind.value(random))
            ground = fault == "ice_patch"
            true.add(component.DRIVE if ground else f"wheel/{names[wheel]}/{part}")
    votes: Counter[tuple[tuple[str, ...], str]] = Counter()
    rolled_m = stood_s = 0.0
    tenths, place = 0, Layout(rig.config).drive.xy[wheels[0]].tolist()
    while tenths < 10 * kind.lasts_s or (
        (rolled_m < kind.rolls_m or stood_s < kind.stands_s) and tenths < 10 * LONGEST_S
    ):
        for _ in range(10):
            told = _told(rig, place)
            rig.cycle()
            rolled_m += 0.01 * told
            stood_s += 0.01 * bool(told > TOLD_M_S and rig.simulation.blocked[wheels[0]])
        tenths += 1
        votes[_paper(rig.residuals)] += 1
    started = [
        report
        for report in rig.reports
        if report.status == "active" and report.code not in COMPLAINTS
    ]
    final = [(code, path) for code, path in rig.active() if code not in COMPLAINTS]
    if kind.named == 0.0:  # what passes by itself counts if it was named at all
        final = [(report.code, report.component) for report in started]
    named = {path for _, path in final} == true
    votes.pop(((), ""), None)
    by_paper, fault = votes.most_common(1)[0][0] if votes else ((), "")
    return Outcome(
        number,
        (started[0].stamp - begin) / 1e9 if started else None,
        bool(started) and started[0].component in true,
        named,
        bool({path for _, path in final} - true),
        named and all(code in kind.codes for code, _ in final),
        set(by_paper) == true,
        set(by_paper) == true and fault == kind.fault,
    )


def having(drive: DriveConfig, kind: Kind) -> list[int]:
    """Wheels that have the parts which faults of a kind concern."""
    steerings = any(fault.startswith("steering") for fault in kind.faults)
    drives = not all(fault.startswith("steering") for fault in kind.faults)
    return [
        i
        for i, wheel in enumerate(drive.wheels)
        if not (steerings and wheel.steering is None) and not (drives and wheel.drive is None)
    ]


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
    seeds: str = "judge",
) -> list[Table]:
    """Cost, then all robots in two processes.

    Args:
        quick: A few robots.
        robots: Of each number of wheels, in the fast simulation.
        mujoco: The same with contact physics.
        seeds: ``judge`` or ``tune``.
    """
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


def _faults_table(robots: list[Robot], wheels: int, title: str) -> Table:
    title = f"Diagnoser: {wheels} steered wheels, {title}, {len(robots)} robots"
    shown = Table(title=title, title_justify="left")
    for heading in (
        "fault", "seen %", "first right %", "named %", "kind %", "p50 s", "p95 s",
        "paper: named %", "paper: kind %", "met",
    ):  # fmt: skip
        shown.add_column(heading, justify="left" if heading == "fault" else "right")
    for number, kind in enumerate(KINDS):
        rows = [row for robot in robots for row in robot.outcomes if row.kind == number]
        times = sorted(row.first_s if row.first_s is not None else math.inf for row in rows)
        named = sum(row.named for row in rows) / len(rows)
        median = times[(len(times) - 1) // 2]
        met = named >= kind.named and (not kind.first_s or median <= kind.first_s)
        shown.add_row(
            kind.name,
            _share([row.first_s is not None for row in rows]),
            _share([row.first for row in rows]),
            _share([row.named for row in rows]),
            _share([row.code for row in rows]),
            f"{median:.2f}",
            f"{times[math.ceil(0.95 * len(times)) - 1]:.2f}",
            _share([row.by_paper for row in rows]),
            _share([row.by_paper_kind for row in rows]) if kind.fault else "",
            {True: "[green]yes", False: "[red]NO"}[met] if kind.named else kind.untold and "cannot",
        )
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
    shown = Table(title=f"{title}, named % / another part named %", title_justify="left")
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
    single = [row for kind, row in every if kind.named == NAMED]
    either = [row for kind, row in every if kind.named == NAMED and kind.fault]
    double = [row for kind, row in every if len(kind.faults) > 1]
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
        shown.append([name, *[""] * (place - 1), f"{100 * share:.2f}", *[""] * (8 - place), met])
    return shown


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
    alone = _cycles(drives["4 steered wheels"], shown=False)
    collect_rarely()  # as the service does
    *figures, unseen, bare = side_by_side(
        *actions, alone, _bare(4), rounds=rounds, calls=calls, cpu=True
    )
    by_name = dict(zip(drives, figures, strict=True))
    of_four, of_eight = STEP_US
    four, peer = by_name[of_four], ("least squares, candidates", bare)
    return [
        table(
            "Diagnoser: CPU of a step with a gyro and a new command, nothing wrong",
            [
                Figure(name, figure, "µs", None, STEP_US.get(name))
                for name, figure in by_name.items()
            ]
            + [
                Figure(f"{of_four}, by their peer", four, "µs", peer, STEP_BY_PEER),
                Figure(f"{of_four}, nobody looks", unseen, "µs", None, STEP_US[of_four]),
                Figure("8 wheels by 4", by_name[of_eight] / four, ""),
            ],
        )
    ]


def _cycles(config: DriveConfig, *, shown: bool = True) -> Prepared[Cycle]:
    """Cycles of a robot that drives; none twice: where the robot would jump back, there would be
    something to diagnose.

    Args:
        config: Of the robot.
        shown: Whether somebody looks at residuals.
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
