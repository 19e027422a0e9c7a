"""``wackel doctor``: what is most often wrong on a robot computer, and what to do about it."""

import argparse
import json
import os
import platform
import pwd
import stat
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from wackel_imu.device import DeviceLost, find
from wackel_node.arguments import ELSE_DEFAULTS, add_config_first, config_of
from wackel_node.config import BusConfig, RobotConfig
from wackel_node.config_drive import GyroConfig
from wackel_node.errors import FAILED, OK
from wackel_node.precedence import CONTROL, may_come_first

PYTHON = (3, 11)
ZENOH = (1, 10)
LATENCY_MS = 1  # the adapter's default of 16 ms costs more than a whole cycle

Result = Literal["good", "warning", "bad"]


@dataclass(frozen=True)
class Finding:
    """One check.

    Attributes:
        check: What was looked at.
        result: ``bad`` keeps the robot from working, a ``warning`` costs speed or robustness.
        seen: What was found.
        remedy: What to do about it; empty if good.
    """

    check: str
    result: Result
    seen: str
    remedy: str = ""


def examine(config: RobotConfig, root: Path = Path("/")) -> Iterator[Finding]:
    """All checks; ``root`` is where /sys, /proc and /dev are looked for."""
    yield _python()
    yield _zenoh()
    yield _rendezvous(config)
    for name, bus in config.buses.items():
        yield _port(name, bus)
        latency = _latency_timer(name, bus, root)
        if latency is not None:
            yield latency
    if not config.buses:
        yield Finding(
            "buses", "warning", "no bus is configured", "`wackel scan --write robot.toml`"
        )
    for name, gyro in config.gyros.items():
        if gyro.source == "iio":
            yield _gyro(name, gyro, root)
    yield _modem_manager(root)
    yield _governor(root)
    yield _precedence()


def _python() -> Finding:
    seen = platform.python_version()
    if sys.version_info >= PYTHON:
        return Finding("Python", "good", seen)
    return Finding("Python", "bad", seen, f"install Python {PYTHON[0]}.{PYTHON[1]} or later")


def _zenoh() -> Finding:
    try:
        seen = version("eclipse-zenoh")
    except PackageNotFoundError:
        return Finding("Zenoh", "bad", "not installed", "install wackel anew: `pip install wackel`")
    numbers = tuple(int(part) for part in seen.split(".")[:2] if part.isdecimal())
    if numbers >= ZENOH:
        return Finding("Zenoh", "good", seen)
    return Finding("Zenoh", "bad", seen, f"install eclipse-zenoh {ZENOH[0]}.{ZENOH[1]} or later")


def _rendezvous(config: RobotConfig) -> Finding:
    from wackel_node.session import NotReached, session

    endpoint = config.zenoh.endpoint
    try:
        with session(config, "client"):
            return Finding("rendezvous", "good", f"listens at {endpoint}")
    except NotReached:
        return Finding(
            "rendezvous",
            "warning",
            f"nothing listens at {endpoint}",
            "start the robot with `wackel up robot.toml`, or zenohd by systemd",
        )


def _port(name: str, bus: BusConfig) -> Finding:
    check = f"port of bus {name}"
    port = Path(bus.port)
    if not port.exists():
        there = sorted(str(p) for p in Path("/dev").glob("tty[UA][SC][BM]*"))
        return Finding(
            check,
            "bad",
            f"{port} does not exist; there is {', '.join(there) or 'no USB serial port'}",
            "plug the adapter in, or correct `port` in robot.toml; compose/udev gives it a name "
            "that stays",
        )
    if not os.access(port, os.R_OK | os.W_OK):
        return Finding(
            check,
            "bad",
            f"{_user()} may not open {port}",
            _permit(port),
        )
    return Finding(check, "good", f"{port} can be opened")


def _permit(port: Path) -> str:
    """How to get access: by joining the port's group, if that has access and is not root's."""
    group, mode = _group_of(port), port.stat().st_mode
    if group != "root" and mode & stat.S_IRGRP and mode & stat.S_IWGRP:
        return f"`sudo usermod -aG {group} {_user()}`, then log in again"
    return f"`sudo chgrp dialout {port} && sudo chmod 660 {port}`, until a udev rule does it"


def _user() -> str:
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:  # a container runs under numbers that have no name
        return str(os.getuid())


def _group_of(path: Path) -> str:
    try:
        return path.group()
    except KeyError:
        return str(path.stat().st_gid)


def _latency_timer(name: str, bus: BusConfig, root: Path) -> Finding | None:
    """Only drivers of adapters with a latency timer (FTDI) show one."""
    device = Path(bus.port).resolve().name
    text = _read(root / "sys/class/tty" / device / "device/latency_timer")
    if text is None or not text.isdecimal():
        return None
    check = f"latency timer of bus {name}"
    if int(text) <= LATENCY_MS:
        return Finding(check, "good", f"{text} ms")
    return Finding(
        check,
        "warning",
        f"{text} ms: answers wait that long in the adapter",
        "install compose/udev/99-wackel.rules and plug the adapter again",
    )


def _gyro(name: str, gyro: GyroConfig, root: Path) -> Finding:
    check = f"gyro {name}"
    try:
        directory = find(gyro.device or "", root / "sys")
    except DeviceLost as lost:
        remedy = f"load its driver, or correct `device` of gyros.{name} in robot.toml"
        return Finding(check, "bad", str(lost), remedy)
    switch, node = directory / "buffer/enable", root / "dev" / directory.name
    if not switch.exists():
        remedy = "take another driver, or publish its samples yourself (source = 'topic')"
        return Finding(check, "bad", f"the driver of {gyro.device} has no buffer", remedy)
    if not (os.access(switch, os.W_OK) and os.access(node, os.R_OK)):
        remedy = "install compose/udev/99-wackel.rules, then `sudo udevadm trigger`"
        return Finding(check, "bad", f"{_user()} may not set up and read {node}", remedy)
    return Finding(check, "good", f"{gyro.device} can be read at {node}")


def _modem_manager(root: Path) -> Finding:
    names = (_read(path) for path in (root / "proc").glob("[0-9]*/comm"))
    if "ModemManager" not in names:
        return Finding("ModemManager", "good", "does not run")
    return Finding(
        "ModemManager",
        "warning",
        "runs, and sends modem commands to new serial ports",
        "install compose/udev/99-wackel.rules, or `sudo systemctl disable --now ModemManager`",
    )


def _governor(root: Path) -> Finding:
    files = (root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    governors = sorted({text for text in map(_read, files) if text})
    seen = ", ".join(governors) or "not governed by this system"
    if "powersave" not in governors:
        return Finding("CPU governor", "good", seen)
    return Finding(
        "CPU governor",
        "warning",
        f"{seen}: the CPU wakes slowly",
        "`echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor`",
    )


def _precedence() -> Finding:
    check = "real-time priority"
    if may_come_first():
        return Finding(check, "good", "allowed")
    return Finding(
        check,
        "warning",
        f"{_user()} may not take it: answers and faults wait for other programs",
        f"`echo '{_user()} - rtprio {CONTROL}' | sudo tee /etc/security/limits.d/wackel.conf`, "
        "then log in again",
    )


def _read(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):  # not there, not ours to read, or a process that ended
        return None


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel doctor",
        description="Checks what is most often wrong on a robot computer and says what to do. "
        "Exit code 1 if anything keeps the robot from working.",
    )
    add_config_first(parser, ELSE_DEFAULTS)
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args(argv)
    config = config_of(arguments)
    findings = list(examine(config))
    if arguments.json:
        print(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        width = max(len(finding.check) for finding in findings)
        for finding in findings:
            print(f"{finding.result:<9}{finding.check:<{width}}  {finding.seen}")
            if finding.remedy:
                print(f"{'':<{width + 9}}  → {finding.remedy}")
    return FAILED if any(finding.result == "bad" for finding in findings) else OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
