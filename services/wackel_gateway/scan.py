"""``wackel scan``: who is on a bus, and a robot.toml to start from."""

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import msgspec
from rich.box import SIMPLE
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from serial.tools import list_ports

from wackel_gateway.port import Port, PortLost
from wackel_gateway.survey import ALL_IDS, Found, Survey
from wackel_node import log
from wackel_node.arguments import id_list
from wackel_node.config import BusConfig, RobotConfig, ServoConfig
from wackel_node.errors import FAILED, OK, USAGE, Explained
from wackel_node.toml_text import toml_text
from wackel_protocols.dynamixel2.control_table import BAUD_RATES

_DESCRIPTION = """\
Looks for Dynamixel servos: pings at every baud rate and lists who answers.
Nothing is changed on the servos. No other program may have the port open; stop
`wackel up` first.
"""
_EPILOG = """\
examples:
  wackel scan                      the only adapter, all baud rates, all ids
  wackel scan --port /dev/ttyUSB0 --baud 1000000
  wackel scan --ids 1-20,30        these ids, one by one
  wackel scan --thorough           all ids one by one: slower, but finds servos
                                   whose answers collide or are disturbed
  wackel scan --write robot.toml   also writes a configuration to start from

exit codes: 0 servos found, 1 none found or no port, 2 wrong usage
"""
_BY_ID = Path("/dev/serial/by-id")
_UNKNOWN_MODEL = "X"  # the commonest series; addresses hold for all of it


class NoPort(Explained):
    """There is no port to scan, or it cannot be used; the text says which there are."""


class BadUsage(Explained):
    """Arguments that make no sense together."""

    exit_code = USAGE


def main(argv: list[str]) -> int:
    """Runs a scan; returns the exit code."""
    arguments = _parse(argv)
    log.set_up("scan")
    if arguments.write is not None and arguments.write.exists():
        raise BadUsage(f"{arguments.write} exists; choose another name, or move it away first")
    path = arguments.port or _only_port()
    baud_rates = arguments.baud or list(BAUD_RATES)
    ids = list(ALL_IDS) if arguments.thorough else arguments.ids
    found = _survey(path, baud_rates, ids)
    if arguments.json:
        print(msgspec.json.format(msgspec.json.encode(found), indent=2).decode())
    elif found:
        Console().print(_table(found))
    if not found:
        print(
            f"wackel scan: no servo answers on {path}. Is the supply on, is the cable in, is "
            "protocol 2.0 set?" + ("" if ids else " Try --thorough."),
            file=sys.stderr,
        )
        return FAILED
    if arguments.write is not None:
        arguments.write.write_text(robot_toml(stable_name(path), found), encoding="utf-8")
        print(f"{arguments.write} written; now put its servos into cable order", file=sys.stderr)
    return OK


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="wackel scan",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--port", metavar="P", help="serial port (default: the only USB adapter)")
    parser.add_argument(
        "--baud",
        metavar="RATE",
        type=int,
        nargs="+",
        choices=BAUD_RATES,
        help=f"bit/s (default: all of {', '.join(map(str, BAUD_RATES))})",
    )
    asked = parser.add_mutually_exclusive_group()
    asked.add_argument("--ids", metavar="IDS", type=id_list, default=[], help="such as 1-20,30")
    asked.add_argument("--thorough", action="store_true", help="ping every id on its own")
    parser.add_argument("--write", metavar="FILE", type=Path, help="write a robot.toml")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    return parser.parse_args(argv)


def _only_port() -> str:
    paths = [port.device for port in list_ports.comports() if port.vid is not None]
    if len(paths) == 1:
        return str(paths[0])
    there = f"there are {', '.join(paths)}" if paths else "no USB adapter is plugged in"
    raise NoPort(f"say which port with --port; {there}")


def _survey(path: str, baud_rates: Sequence[int], ids: Sequence[int]) -> list[Found]:
    stopped: list[bool] = []
    previous = signal.signal(signal.SIGINT, lambda *_: stopped.append(True))
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    try:
        with Port(path, baud_rates[0]) as port, bar:
            task = bar.add_task(f"scanning {path}", total=1.0)
            survey = Survey(port, lambda: bool(stopped), lambda share: bar.advance(task, share))
            found = survey.run(baud_rates, ids)
    except PortLost as lost:
        raise NoPort(f"{path}: {lost}") from lost
    finally:
        signal.signal(signal.SIGINT, previous)
    if stopped:
        raise KeyboardInterrupt
    return found


def _table(found: Sequence[Found]) -> Table:
    table = Table(box=SIMPLE, padding=0, pad_edge=False)
    for heading in ("id", "model", "firmware", "baud rate", "voltage", "temp.", "return\ndelay"):
        justify: Literal["left", "right"] = "left" if heading == "model" else "right"
        table.add_column(heading, justify=justify, no_wrap=True)
    table.add_column("hardware\nerror")
    for servo in found:
        table.add_row(
            str(servo.id),
            servo.model or f"unknown ({servo.model_number})",
            str(servo.firmware),
            str(servo.baud_rate),
            _with_unit(servo.voltage, ".1f", "V"),
            _with_unit(servo.temperature, ".0f", "°C"),
            _with_unit(servo.return_delay_us, ".0f", "µs"),
            ", ".join(servo.hardware_errors) or "none",
        )
    return table


def _with_unit(value: float | None, form: str, unit: str) -> str:
    return "?" if value is None else f"{value:{form}} {unit}"


def robot_toml(port: str, found: Sequence[Found]) -> str:
    """A configuration with the servos of the commonest baud rate, by id; comments say the rest."""
    rates = [servo.baud_rate for servo in found]
    rate = max(rates, key=rates.count)
    servos = [
        ServoConfig(id=servo.id, model=servo.model or _UNKNOWN_MODEL)
        for servo in found
        if servo.baud_rate == rate
    ]
    config = RobotConfig(buses={"main": BusConfig(port=port, baud_rate=rate, servos=servos)})
    tree = msgspec.to_builtins(config)
    bus = tree["buses"]["main"]
    chosen = {key: bus[key] for key in ("port", "baud_rate", "mode", "rate", "power", "servos")}
    comments = [
        "Written by `wackel scan`. `wackel config` shows every other key with its default.",
        "",
        "CABLE ORDER IS UNKNOWN: below, the servos stand by id. Put them into the order in which",
        "the cable passes them, from the adapter outwards, or faults will be named at the wrong",
        "cable. Set `power` to where the supply enters: before the first servo (adapter), after",
        "the last (far), or both.",
    ]
    comments += [
        f"Servo {servo.id} answers at {servo.baud_rate} bit/s, so it is not part of this bus."
        for servo in found
        if servo.baud_rate != rate
    ]
    comments += [
        f"Servo {servo.id} has the unknown model number {servo.model_number}; "
        f"{_UNKNOWN_MODEL} is a guess."
        for servo in found
        if servo.model is None
    ]
    head = "\n".join(f"# {line}".rstrip() for line in comments)
    return f"{head}\n\n{toml_text({'robot': config.robot, 'buses': {'main': chosen}})}"


def stable_name(path: str) -> str:
    """The name of a port that survives replugging, where udev gives one."""
    if _BY_ID.is_dir():
        for link in sorted(_BY_ID.iterdir()):
            if link.resolve() == Path(path).resolve():
                return str(link)
    return str(Path(path).absolute())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
