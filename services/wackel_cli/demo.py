"""``wackel demo``: a virtual robot drives; every ten seconds a fault is injected and named."""

import argparse
import math
import shutil
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from wackel_cli.lines import printable
from wackel_cli.robot_model import RobotModel
from wackel_cli.robot_screen import render
from wackel_cli.supervisor import Change, Job
from wackel_cli.top import follow
from wackel_cli.up import rendezvous, robot_jobs, stopped_by_signals, supervised
from wackel_cli.wheeled_robot import BUS, PILOT, WHEELS, three_wheels, with_physics
from wackel_node import log
from wackel_node.arguments import count
from wackel_node.config import RobotConfig, ServoConfig, dump
from wackel_node.errors import FAILED, OK
from wackel_node.keyboard import Keyboard
from wackel_node.link import Link
from wackel_schemas.bus import BusRequest
from wackel_schemas.health import FaultRecord
from wackel_schemas.keys import BUS_REQUEST, VIRTUAL_REQUEST
from wackel_schemas.virtual import Injection, VirtualRequest
from wackel_view.__main__ import PORT as VIEW_PORT
from wackel_view.__main__ import write_layout

PERIOD_S = 10.0
SHOWN_S = 6.0  # how long a fault stays at least, so that one can read it
START_S = 60.0
DRIVEN_S = 5.0  # a diagnosis gets to know a robot that drives
WELL_S = 30.0  # a busy computer sees worse that a wheel is sound again
AGAIN_S = 1.0  # until the robot is asked once more that did not answer
LIMIT_S = 15.0  # a loose contact may take ten seconds to be told from ordinary loss
SERVOS = 12
SPEED_M_S = 0.3  # as fast as an XM430 turns a wheel of 5 cm, with some reserve
_REDRAW_S = 0.25
_STORY_LINES = 4  # as many as one fault has
_LAST_WORDS = 20  # lines of the services' log, if they do not come up


@dataclass(frozen=True)
class Episode:
    """One fault of the demonstration.

    Attributes:
        story: What is done to the virtual robot, in words.
        injection: The same for the virtual robot.
        codes: Any of these names it rightly.
        reboot: Servo that has to be rebooted after the repair.
    """

    story: str
    injection: Injection
    codes: tuple[str, ...]
    reboot: int | None = None


def _at(kind: str, servo: int | None = None) -> Injection:
    return Injection(kind=kind, servo=servo)


def _on(kind: str, wheel: str | None = None, value: float | None = None) -> Injection:
    return Injection(kind=kind, wheel=wheel, value=value)


EPISODES = (  # faults of the drive and of the bus in turns
    Episode("the encoder of wheel w1 dies", _on("drive_sensor_stuck", "w1"), ("wheel_sensor",)),
    Episode("someone pulls the cable to servo 5", _at("break", 5), ("cable_break",)),
    Episode("wheel w2 jams", _on("wheel_blocked", "w2"), ("wheel_blocked",)),
    Episode("servo 8 falls silent", _at("silent", 8), ("servo_silent",)),
    Episode(
        "the steering of wheel w3 stands 17° off",
        _on("steering_offset", "w3", 0.3),
        ("steering_offset", "steering_blocked"),
    ),
    Episode(
        "the cable to servo 8 gets a loose contact",
        Injection(kind="loose_contact", servo=8, value=10.0),
        ("loose_contact",),
    ),
    Episode("the gyro's bias jumps", _on("gyro_offset", None, 0.3), ("gyro_deviates",)),
    Episode(
        "a damaged servo pulls the bus low between packets",
        _at("rhythmic_jammer"),
        ("rhythmic_jammer",),
    ),
    Episode("the motor of wheel w1 is off", _on("wheel_free", "w1"), ("wheel_free",)),
    Episode("servo 7 is overloaded", _at("overload", 7), ("overload",), reboot=7),
    Episode(
        "the steering of wheel w1 shows a wrong angle",
        _on("steering_sensor_offset", "w1", 0.3),
        ("steering_sensor",),
    ),
    Episode("servo 4 becomes slow", _at("slow", 4), ("slow_servo",)),
    Episode("the gyro freezes", _on("gyro_frozen"), ("gyro_frozen",)),
    Episode("a damaged servo writes without pause", _at("permanent_jammer"), ("permanent_jammer",)),
    Episode(
        "wheel w3 sticks again and again",
        _on("wheel_temporarily_blocked", "w3"),
        ("wheel_sticks", "wheel_blocked"),
    ),
    Episode(
        "the power contact of the cable to servo 6 corrodes",
        _at("contact_resistance", 6),
        ("contact_resistance",),
    ),
    Episode(
        "the encoder of wheel w2 shows a fifth too much",
        _on("drive_sensor_scale", "w2", 0.2),
        ("wheel_sensor",),
    ),
    Episode("the battery is disconnected", _at("power_off"), ("no_power", "lost_signal")),
    Episode(
        "wheel w3 turns half as fast as it is told",
        _on("drive_scale", "w3", -0.5),
        ("wheel_deviates",),
    ),
    Episode("the USB adapter is unplugged", _at("unplugged"), ("adapter_unplugged",)),
)


def main(argv: list[str]) -> int:
    """Runs the demonstration; returns 1 if a fault was not named in time."""
    parser = argparse.ArgumentParser(
        prog="wackel demo",
        description="Shows what wackel does, without hardware: a virtual robot with 12 servos on a "
        "pseudo-terminal drives an eight on three steered wheels, all services run as processes, "
        "and every ten seconds a new fault of bus or drive is injected, named and healed. q or "
        "Ctrl-C ends it and leaves nothing behind.",
        epilog="While it runs, its robot can be looked at from elsewhere: see the line `look`.",
    )
    parser.add_argument("--plain", action="store_true", help="lines of text instead of the view")
    parser.add_argument(
        "--view", action="store_true", help="show the robot in a Foxglove viewer, too"
    )
    parser.add_argument(
        "--faults",
        type=count,
        metavar="N",
        help="end after N faults (default: go on until stopped)",
    )
    arguments = parser.parse_args(argv)
    console = Console(highlight=False)
    plain = arguments.plain or not console.is_terminal
    with TemporaryDirectory(prefix="wackel-demo-") as directory:
        config = _config(Path(directory))
        path = Path(directory) / "robot.toml"
        path.write_text(dump(config), encoding="utf-8")
        jobs = _jobs(config, path)
        if arguments.view:
            port, layout = _viewer_port(), Path(directory) / "layout.json"
            jobs.append(Job("view", ("view", "--config", str(path), "--port", str(port))))
            write_layout(layout)
        with (
            (Path(directory) / "services.log").open("w", encoding="utf-8") as services_log,
            rendezvous(config, jobs) as link,
            stopped_by_signals(link) as stopped,
        ):
            log.set_up("demo")
            # Not in the PATH of who has just cloned it.
            command = "wackel" if shutil.which("wackel") else sys.argv[0]
            hints = [f"look: {command} top --config {path}"]
            if arguments.view:
                hints.append(f"view: ws://127.0.0.1:{port} with the layout {layout}")
            show = Show(link, config, arguments.faults, hints)
            view = _plain if plain else _live
            with supervised(link, jobs, show.note, services_log) as supervisor:

                def going_on() -> bool:
                    supervisor.step()
                    show.step(time.monotonic())
                    return not (stopped() or show.over)

                view(show, console, going_on)
        if not show.began:
            words = (Path(directory) / "services.log").read_text(encoding="utf-8").splitlines()
            print("the demo did not begin; the last words of its services:", file=sys.stderr)
            print(*words[-_LAST_WORDS:], sep="\n", file=sys.stderr)
        elif show.shown:
            print(f"{show.shown - show.missed} of {show.shown} faults were named in time")
    return FAILED if show.missed or not show.began else OK


class Show:
    """The course of the demonstration: inject, wait to be named, heal, wait to be healed.

    Attributes:
        model: What the robot's topics say.
        hints: How else it can be looked at, a line each.
        story: What has happened so far, a line each, newest last.
        shown, missed: Faults that were injected and healed; of them, those that were not named
            within their time.
        began: There was health, or the user did not wait for it.
        over: All the faults that were asked for have been shown, or the robot did not come up.
    """

    def __init__(
        self, link: Link, config: RobotConfig, faults: int | None, hints: Sequence[str] = ()
    ) -> None:
        self.model = RobotModel(config)
        self.link = link
        self.hints = hints
        self.story: list[str] = []
        self.shown = self.missed = 0
        self.over = False
        self.began = True
        self._left = faults
        self._begin_s = time.monotonic()
        self._next = 0
        self._tried: Episode | None = None
        self._episode: Episode | None = None
        self._injected_s = -PERIOD_S
        self._again_s = 0.0
        self._patient_until_s = time.monotonic() + START_S
        self._stood_s = time.monotonic()
        self._named = False
        self._known: set[tuple[str, str, int]] = set()
        follow(link, self.model)

    def tell(self, line: str) -> None:
        """Adds a line to the story."""
        self.story.append(printable(f"{time.monotonic() - self._begin_s:6.1f} s  {line}"))

    def note(self, change: Change) -> None:
        """A process of the robot started or ended."""
        if change.event in ("exited", "given up", "killed"):
            self.tell(f"{change.name} ended: {change.detail}")

    def step(self, now_s: float) -> None:
        """Does what is due."""
        if not self._drives(now_s):
            self._stood_s = now_s
        if self._episode is None:
            if self._left == 0:
                self.over = True
            elif now_s - self._injected_s >= PERIOD_S and self._may_go_on(now_s):
                self._inject(EPISODES[self._next % len(EPISODES)], now_s)
            return
        if not self._named:
            self._look_for(self._episode, now_s)
        lasts_s = SHOWN_S if self._named else LIMIT_S
        if now_s - self._injected_s >= lasts_s and now_s >= self._again_s:
            self._heal(self._episode)

    def _may_go_on(self, now_s: float) -> bool:
        """Whether the robot is well again, or has not become so for long enough."""
        health = self.model.health
        if health is None:
            if now_s >= self._patient_until_s:
                self.began, self.over = False, True
            return False
        if health.level == "ok" and now_s - self._stood_s >= DRIVEN_S:
            return True
        if now_s < self._patient_until_s:
            return False
        self.tell(f"not well yet: {health.summary}")
        return True

    def _drives(self, now_s: float) -> bool:
        odometry, at_s = self.model.odometry, self.model.odometry_s
        return (
            odometry is not None
            and at_s is not None
            and now_s - at_s < 1.0
            and math.hypot(odometry.vx, odometry.vy) > SPEED_M_S / 2
        )

    def _inject(self, episode: Episode, now_s: float) -> None:
        if episode is not self._tried:  # else its fault may be there, only the answer was late
            self._tried = episode
            self._known = {_occurrence(fault) for fault in self.model.faults("confirmed", "healed")}
        self._injected_s = now_s  # or tried to
        if self._done(lambda: self._virtual("inject", episode.injection)):
            self._episode, self._tried, self._named = episode, None, False
            self.tell(f"now {episode.story}")

    def _look_for(self, episode: Episode, now_s: float) -> None:
        for fault in self.model.faults("confirmed"):
            if fault.code in episode.codes and _occurrence(fault) not in self._known:
                self._named = True
                took_s = now_s - self._injected_s
                self.tell(f"wackel after {took_s:.2f} s: {fault.message}")
                self.tell(f"  → {fault.remedy}")
                return

    def _heal(self, episode: Episode) -> None:
        if not self._done(lambda: self._repair(episode)):
            self._again_s = time.monotonic() + AGAIN_S
            return
        self.shown += 1
        if not self._named:
            self.missed += 1
            self.tell("wackel has not named it in time")
        self.tell("the demo has repaired it")
        self._patient_until_s = time.monotonic() + WELL_S
        self._episode = None
        self._next += 1
        if self._left is not None:
            self._left -= 1

    def _repair(self, episode: Episode) -> None:
        self._virtual("heal", episode.injection)
        if episode.reboot is not None:
            request = BusRequest(operation="reboot", id=episode.reboot)
            self.link.ask(BUS_REQUEST, request, bus=BUS)

    def _virtual(self, operation: Literal["inject", "heal"], injection: Injection) -> None:
        request = VirtualRequest(operation=operation, injection=injection)
        reply = self.link.ask(VIRTUAL_REQUEST, request)
        if not reply.ok:
            raise AssertionError(f"{injection}: {reply.text}")  # the demo's own robot has it all

    def _done(self, act: Callable[[], None]) -> bool:
        """Whether it was done; a process that has just been restarted does not answer yet."""
        try:
            act()
        except TimeoutError:
            self.tell("the robot does not answer: once more")
            return False
        return True


def _occurrence(fault: FaultRecord) -> tuple[str, str, int]:
    return fault.code, fault.component, fault.occurrences


def _plain(show: Show, console: Console, going_on: Callable[[], bool]) -> None:
    for hint in show.hints:
        console.print(hint, soft_wrap=True)
    told = 0
    while going_on():
        for line in show.story[told:]:
            console.print(line, soft_wrap=True)
        told = len(show.story)
        show.link.pump(_REDRAW_S)


def _live(show: Show, console: Console, going_on: Callable[[], bool]) -> None:
    with (
        Keyboard() as keyboard,
        Live(console=console, screen=True, auto_refresh=False, transient=True) as live,
    ):
        due_s = 0.0
        while going_on() and "q" not in keyboard.typed():
            show.link.pump(_REDRAW_S)
            now_s = time.monotonic()
            if now_s >= due_s:
                due_s = now_s + _REDRAW_S
                live.update(Group(*_screen(show, now_s, *console.size)), refresh=True)


def _screen(show: Show, now_s: float, width: int, height: int) -> list[Text]:
    """The robot, below it the latest of the story, and the hints."""
    story = [Text(line, style="cyan", overflow="ellipsis") for line in show.story[-_STORY_LINES:]]
    story += [Text(printable(line), style="dim", overflow="ellipsis") for line in show.hints]
    for line in story:
        line.truncate(width, overflow="ellipsis")
    return [*render(show.model, now_s, width, height - len(story)), *story]


def _config(directory: Path) -> RobotConfig:
    """Three steered wheels on the first half of the chain, an arm on the second."""
    roles = [f"{part} of {wheel}" for wheel in WHEELS for part in ("drive", "steering")]
    roles += [f"joint {i}" for i in range(1, SERVOS - len(roles) + 1)]
    servos = [
        ServoConfig(id=i, model="XM430-W210", role=role) for i, role in enumerate(roles, start=1)
    ]
    return three_wheels("demo", directory, servos, nominal_voltage=12.0)


def _jobs(config: RobotConfig, path: Path) -> list[Job]:
    """The robot's, and a pilot that drives it."""
    physics = "fast" if find_spec("mujoco") is None else "mujoco"
    pilot = ("pilot", "--config", str(path), "--path", "eight", "--speed", str(SPEED_M_S))
    return [
        *with_physics(robot_jobs(config, path, virtual=True), physics),
        Job(PILOT, pilot, after=(f"gateway/{BUS}",)),
    ]


def _viewer_port() -> int:
    """Where viewers look first, or else any that is free."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", VIEW_PORT))
        except OSError:
            probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
