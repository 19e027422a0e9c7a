"""``wackel up``: a robot's rendezvous and all its services, kept running."""

import argparse
import json
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import IO

from wackel_cli.lines import printable
from wackel_cli.supervisor import Change, Job, Supervisor
from wackel_node import log
from wackel_node.arguments import DEFAULT, add_config_first
from wackel_node.config import RobotConfig, load
from wackel_node.errors import OK, AlreadyRunning
from wackel_node.link import Link
from wackel_node.session import NotReached
from wackel_node.stop_signals import stop_signals
from wackel_recording.reader import open_recordings
from wackel_schemas import keys
from wackel_schemas.health import Health, Heartbeat

_PATIENCE_S = 10.0  # what a computer that boots needs to start all services at once
_PROCESSES_TOLD = 2  # of one service: the one before a restart and the one after


def main(argv: list[str]) -> int:
    """Runs a robot until Ctrl-C or SIGTERM; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel up",
        description="Runs everything in robot.toml as processes that meet at a rendezvous in this "
        "one, restarts what dies, and says who is up. Ctrl-C stops all of them within a second.",
        epilog="All services end with this process, whatever ends it. On a robot whose control "
        "must go on (mode proxy), let systemd run the services instead: compose/systemd.",
    )
    add_config_first(parser)
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--virtual", action="store_true", help="with virtual servos on the ports")
    source.add_argument(
        "--play",
        metavar="FILE",
        type=Path,
        help="with this recording in the place of gateways and sensors",
    )
    parser.add_argument("--record", action="store_true", help="record all topics")
    parser.add_argument(
        "--external-rendezvous",
        action="store_true",
        help="use the zenohd at zenoh.endpoint; without it up listens there itself, or uses what "
        "it finds",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    arguments = parser.parse_args(argv)
    log.set_up("up")
    path = arguments.config or DEFAULT
    config = load(path)
    if not config.buses:
        log.logger.warning("%s lists no bus: nothing but faults of others is watched", path)
    if arguments.play is not None:
        open_recordings([arguments.play])  # says what is wrong with it before anything starts
    show = show_json if arguments.json else show_text
    jobs = robot_jobs(
        config,
        path,
        virtual=arguments.virtual,
        record=arguments.record,
        recording=arguments.play,
    )
    with rendezvous(config, jobs, external=arguments.external_rendezvous) as link:
        run(link, jobs, show)
    return OK


def robot_jobs(
    config: RobotConfig,
    path: Path,
    *,
    virtual: bool = False,
    record: bool = False,
    recording: Path | None = None,
) -> list[Job]:
    """What a robot consists of.

    Args:
        config: The robot's.
        path: Where that stands.
        virtual: With a virtual robot, which has to be ready before gateways look for its ports.
        record: With a recorder, even if the configuration has none. Sensors then wait until all
            listen, so that the recording holds everything that services conclude from.
        recording: Played in the place of gateways, once all others listen.
    """

    def job(name: str, command: str, *more: str, after: Iterable[str] = ()) -> Job:
        return Job(name, (command, "--config", str(path), *more), tuple(after))

    recorders = [job("recorder/main", "record")] if record or config.recorder.directory else []
    readers = [
        job("classifier/main", "classifier"),
        *(
            [job("odometry/main", "odometry"), job("diagnoser/main", "diagnoser")]
            if config.drive is not None
            else []
        ),
        job("aggregator/main", "aggregator"),
        *recorders,
    ]
    names = tuple(reader.name for reader in readers)
    if recording is not None:
        player = job("playback/main", "play", str(recording), after=names)
        return [*readers, replace(player, once=True)]
    sources = [
        *(job(f"gateway/{bus}", "gateway", "--bus", bus) for bus in config.buses),
        *(
            job(f"imu/{name}", "imu", "--gyro", name)
            for name, gyro in config.gyros.items()
            if gyro.source == "iio"
        ),
    ]
    if virtual:
        first = replace(job("virtual/main", "virtual"), outlives=True)
        sources = [first, *(replace(each, after=(first.name,)) for each in sources)]
    if recorders:
        # What is recorded from the first message on can be concluded from again; but a robot moves
        # even if a reader does not come up.
        sources = [
            each if each.after else replace(each, after=names, patience_s=_PATIENCE_S)
            for each in sources
        ]
    return [*sources, *readers]


@contextmanager
def rendezvous(
    config: RobotConfig, jobs: Iterable[Job], *, external: bool = False
) -> Iterator[Link]:
    """A link that is the robot's rendezvous, or uses the one that listens already.

    Args:
        config: The robot's.
        jobs: What is to meet there. What else is there already, such as a virtual robot or a
            recorder, joins.
        external: Do not listen there.

    Raises:
        NotReached: The address is taken by something else, or nothing is at an external one.
        AlreadyRunning: A service that is to run is there already.
    """
    with _linked(config, external) as link:
        twice = link.alive() & {job.name for job in jobs}
        if twice:
            names = ", ".join(sorted(twice))
            raise AlreadyRunning(f"robot {config.robot} is up already ({names}); stop it first")
        yield link


def _linked(config: RobotConfig, external: bool) -> Link:
    endpoint = config.zenoh.endpoint
    if external:
        try:
            return Link(config, "client")
        except NotReached as error:
            raise NotReached(f"no zenohd at {endpoint}: start it first") from error
    with suppress(NotReached):
        return Link(config, "router")
    try:
        link = Link(config, "client")
    except NotReached as error:
        raise NotReached(
            f"cannot listen at {endpoint}: it is no address of this computer, or a program that "
            "is no rendezvous has the port; see zenoh.endpoint in robot.toml"
        ) from error
    log.logger.info("using the rendezvous that listens at %s", endpoint)
    return link


def run(link: Link, jobs: list[Job], show: Callable[[str, str, str], None]) -> None:
    """Runs jobs until a signal; tells every change of a process, a service or health."""

    def on_change(change: Change) -> None:
        show(change.name, change.event, f"pid {change.pid} {change.detail}".strip())

    told_of: dict[str, dict[int, str]] = {}

    def on_heartbeat(key: str, beat: Heartbeat) -> None:
        name = key.removeprefix("alive/")
        if is_news(beat, told_of.setdefault(name, {})):
            show(name, beat.state, beat.reason)

    told = ""

    def on_health(_: str, health: Health) -> None:
        nonlocal told
        if health.summary != told:
            told = health.summary
            show("health", health.level, health.summary)

    link.subscribe(keys.ALIVE, on_heartbeat)
    link.subscribe(keys.HEALTH, on_health)
    with stopped_by_signals(link) as stopped, supervised(link, jobs, on_change) as supervisor:
        while not stopped():
            link.pump(supervisor.wait_s())
            supervisor.step()


def is_news(beat: Heartbeat, told: dict[int, str]) -> bool:
    """Whether a process tells a state that is not in ``told``, by boot, which then has it.

    Of one service the two latest processes are remembered: should both live, they take turns
    without end, and each of them is news but once.
    """
    if told.get(beat.boot) == beat.state:
        return False
    told[beat.boot] = beat.state
    while len(told) > _PROCESSES_TOLD:
        del told[next(iter(told))]
    return True


@contextmanager
def supervised(
    link: Link,
    jobs: list[Job],
    on_change: Callable[[Change], None],
    output: IO[str] | None = None,
) -> Iterator[Supervisor]:
    """A supervisor that hears on the link who is ready; arguments as those of Supervisor."""
    supervisor = Supervisor(jobs, on_change, output)

    def on_heartbeat(key: str, beat: Heartbeat) -> None:
        if beat.state == "ready":
            supervisor.ready(key.removeprefix("alive/"))

    link.subscribe(keys.ALIVE, on_heartbeat)
    with supervisor:
        yield supervisor


@contextmanager
def stopped_by_signals(link: Link) -> Iterator[Callable[[], bool]]:
    """Gives a function that tells whether a signal asks to stop.

    Signals, and the death of a child, also end a waiting :meth:`Link.pump`.
    """
    stopping = False

    def stop(*_: object) -> None:
        nonlocal stopping
        stopping = True
        link.wake()

    handlers: dict[signal.Signals, Callable[..., None]] = dict.fromkeys(stop_signals(), stop)
    handlers[signal.SIGCHLD] = lambda *_: link.wake()
    previous = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield lambda: stopping
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def show_text(name: str, event: str, detail: str) -> None:
    """One line for people."""
    line = f"{time.strftime('%H:%M:%S')}  {name:<18}{event:<10}{detail}".rstrip()
    _put(printable(line))  # what health and services say comes from the network


def show_json(name: str, event: str, detail: str) -> None:
    """One line for programs: ``stamp`` (UTC ns), ``name``, ``event``, ``detail``."""
    line = {"stamp": time.time_ns(), "name": name, "event": event, "detail": detail}
    _put(json.dumps(line))


def _put(line: str) -> None:
    # With its end in one write: the services write to the same place, and where Python does not
    # buffer (PYTHONUNBUFFERED) print() would leave them a gap before the end.
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
