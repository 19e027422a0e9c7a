"""``wackel paper``: the experiment of the paper on kinematic diagnosis, through the live system."""

import argparse
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import Progress

from wackel_cli.supervisor import Change, Job
from wackel_cli.up import rendezvous, robot_jobs, stopped_by_signals, supervised
from wackel_cli.wheeled_robot import BUS, PILOT, WHEELS, three_wheels, with_physics
from wackel_node import log
from wackel_node.algebra import single_threaded
from wackel_node.config import RobotConfig, ServoConfig, dump
from wackel_node.errors import FAILED, OK, Explained
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.health import Heartbeat
from wackel_schemas.virtual import Injection, VirtualRequest

if TYPE_CHECKING:  # it needs numpy, which must not start before it is told to use one thread
    from wackel_cli.paper_log import PaperLog

SPEED_M_S, RADIUS_M = 1.5, 1.0
ACCELERATION = 0.05
"""m/s²; full speed after 30 s, before the block."""
PLAY = 0.25
"""Swing of the free wheel by its speed, an assumption: in the paper's figure 6c it is plain to
see."""
READY_S = 30.0
_PUMP_S = 0.1


class NotRun(Explained):
    """The experiment could not be made; the text says why."""


def main(argv: list[str]) -> int:
    """Runs the experiment; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel paper",
        description="Repeats the experiment of Rienmüller, Gruber and Hofbaur, section 5, on a "
        "virtual robot with all services: from rest to 1.5 m/s on a circle of 1 m, wheel 3 free "
        "from the start and blocked after 36 s. Writes the content of the paper's figures 5 and 6 "
        "as figure5.png and figure6.png, and the signatures as signatures.txt. Takes a minute.",
        epilog="Needs MuJoCo and matplotlib: pip install 'wackel[sim]'.",
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, default=Path("paper"), help="where to (./paper)"
    )
    arguments = parser.parse_args(argv)
    missing = [name for name in ("mujoco", "matplotlib") if find_spec(name) is None]
    if missing:
        raise NotRun(f"{' and '.join(missing)} missing: pip install 'wackel[sim]'")
    _prepare(arguments.output)
    log.set_up("paper")
    single_threaded()
    with TemporaryDirectory(prefix="wackel-paper-") as directory:
        heard = _experiment(Path(directory))
    if heard is None:
        return FAILED

    from wackel_cli.paper_figures import figure_5, figure_6
    from wackel_cli.paper_text import story
    from wackel_virtual.drivetrain import PLAY_HZ

    text = story(heard, play=PLAY, hertz=PLAY_HZ)
    (arguments.output / "signatures.txt").write_text(text, encoding="utf-8")
    figure_5(heard, arguments.output / "figure5.png")
    figure_6(heard, arguments.output / "figure6.png")
    print(text)
    print(f"figures and text are in {arguments.output}")
    return OK


def _prepare(output: Path) -> None:
    """Makes the directory and tries it: after the experiment it would be a pity."""
    try:
        output.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=output).close()
    except OSError as error:
        raise NotRun(f"{output}: nothing can be written there: {error.strerror}") from error


def _robot(directory: Path) -> RobotConfig:
    """Small fast servos drive, their slower sisters steer."""
    models = ("XL330-M077", "XL330-M288")
    servos = [ServoConfig(id=i + 1, model=models[i % 2]) for i in range(2 * len(WHEELS))]
    return three_wheels("paper", directory, servos, nominal_voltage=5.0)


def _experiment(directory: Path) -> "PaperLog | None":
    """What was heard of it; absent if a signal ended it."""
    from wackel_cli.paper_log import BLOCKED_S, END_S, PaperLog

    config = _robot(directory)
    assert config.drive is not None
    path = directory / "robot.toml"
    path.write_text(dump(config), encoding="utf-8")
    jobs = with_physics(robot_jobs(config, path, virtual=True), "mujoco")
    pilot = Job(
        PILOT,
        (
            *("pilot", "--config", str(path), "--speed", str(SPEED_M_S)),
            *("--radius", str(RADIUS_M), "--acceleration", str(ACCELERATION)),
        ),
    )
    heard = PaperLog(config.drive)
    with (
        (directory / "services.log").open("w", encoding="utf-8") as services_log,
        rendezvous(config, jobs) as link,
        stopped_by_signals(link) as stopped,
        supervised(link, jobs, _note, services_log) as supervisor,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        task = progress.add_task("starting the services", total=END_S)
        ready: set[str] = set()

        def on_heartbeat(key: str, beat: Heartbeat) -> None:
            if beat.state == "ready":
                ready.add(key.removeprefix("alive/"))

        link.subscribe(keys.ALIVE, on_heartbeat)

        def wait(condition: Callable[[], bool], limit_s: float, what: Callable[[], str]) -> bool:
            """False if a signal came."""
            limit = time.monotonic() + limit_s
            while not condition():
                if stopped():
                    return False
                if time.monotonic() > limit:
                    raise NotRun(f"{what()} within {limit_s:g} s: is the computer too busy?")
                link.pump(_PUMP_S)
                supervisor.step()
                progress.update(task, completed=heard.now_s)
            return True

        def unready() -> str:
            return f"not ready: {', '.join(sorted({job.name for job in jobs} - ready))}"

        if not wait(lambda: ready >= {job.name for job in jobs}, READY_S, unready):
            return None
        _subscribe(link, heard)
        _inject(link, Injection(kind="wheel_free", wheel=WHEELS[2], value=PLAY))
        with supervised(link, [pilot], _note, services_log):
            progress.update(task, description="driving")
            if not wait(lambda: heard.started, READY_S, lambda: "the pilot does not drive"):
                return None
            _inject(
                link,
                Injection(kind="wheel_blocked", wheel=WHEELS[2], start_s=BLOCKED_S - heard.now_s),
            )
            if not wait(lambda: heard.now_s >= END_S, 2 * END_S, lambda: "the bus is silent"):
                return None
    if not heard.residuals:
        raise NotRun("the diagnoser has published no residuals")
    return heard


def _subscribe(link: Link, heard: "PaperLog") -> None:
    link.subscribe(keys.TWIST_COMMAND, lambda _, command: heard.on_command(command))
    link.subscribe(keys.STATE, lambda _, state: heard.on_state(state), bus=BUS)
    link.subscribe(keys.RESIDUALS, lambda _, residuals: heard.on_residuals(residuals))
    link.subscribe(keys.FAULT, lambda _, report: heard.on_fault(report))
    link.subscribe(keys.IMU, lambda _, sample: heard.on_imu(sample))


def _inject(link: Link, injection: Injection) -> None:
    request = VirtualRequest(operation="inject", injection=injection)
    try:
        reply = link.ask(keys.VIRTUAL_REQUEST, request)
    except TimeoutError as error:
        raise NotRun("the virtual robot does not answer: is the computer too busy?") from error
    if not reply.ok:
        raise NotRun(reply.text)


def _note(_: Change) -> None:
    """Starts and ends of processes are of no interest here."""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
