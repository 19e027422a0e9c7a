"""``wackel servo``: talk to servos of a running robot, through its gateway."""

import argparse
import sys
from typing import Literal

import msgspec

from wackel_cli.lines import printable
from wackel_node.arguments import add_config, config_of, id_list
from wackel_node.config import BusConfig, RobotConfig
from wackel_node.errors import FAILED, OK, USAGE, Explained
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.bus import BusRequest

_EPILOG = """\
examples:
  wackel servo ping 5
  wackel servo reboot 5                       clears a hardware error
  wackel servo reboot all                     all that robot.toml lists
  wackel servo read 1-4,7 present_temperature
  wackel servo read 5 present_position
  wackel servo write 5 profile_velocity 100   raw, as in the control table
  wackel servo factory-reset 5 --yes          all registers but id and baud rate

The gateway does it between two cycles, so the robot goes on meanwhile. In the
modes proxy and tap the gateway sends nothing of its own: there the control
software has to do it.

With several servos or all, --json prints a list.

exit codes: 0 done, 1 a servo did not do it, 2 wrong usage, 3 no robot reached
"""
_TIMEOUT_S = 5.0  # a reboot and a write that moves into EEPROM wait for the servo

_OPERATIONS: dict[str, Literal["ping", "reboot", "read", "write", "factory_reset"]] = {
    "ping": "ping",
    "reboot": "reboot",
    "read": "read",
    "write": "write",
    "factory-reset": "factory_reset",
}


class _BadUsage(Explained):
    exit_code = USAGE


def main(argv: list[str]) -> int:
    """Asks the gateway; returns the exit code."""
    arguments = _parser().parse_args(argv)
    config = config_of(arguments)
    bus = arguments.bus or _only_bus(config)
    if bus not in config.buses:
        raise _BadUsage(f"there is no bus {bus!r}; known are {', '.join(config.buses) or 'none'}")
    servos = arguments.ids or list(config.buses[bus].ids())
    if not servos:
        raise _BadUsage(f"robot.toml lists no servos of bus {bus}; name them")
    if arguments.operation == "factory-reset" and not arguments.yes:
        named = ", ".join(map(str, servos))
        raise _BadUsage(f"this erases what servo {named} was set to; say so with --yes")
    if getattr(arguments, "register", None) == "id" and arguments.operation == "write":
        _check_id(servos, arguments.value, config.buses[bus])
    replies = []
    with Link(config) as link:
        for servo in servos:
            request = BusRequest(
                operation=_OPERATIONS[arguments.operation],
                id=servo,
                register=getattr(arguments, "register", None),
                value=getattr(arguments, "value", None),
            )
            try:
                reply = link.ask(keys.BUS_REQUEST, request, _TIMEOUT_S, bus=bus)
            except TimeoutError as error:
                raise link.unanswered(f"gateway of bus {bus}") from error
            replies.append(reply)
            if not arguments.json:
                who = f"servo {servo}: " if len(servos) > 1 or not reply.ok else ""
                line = printable(f"{who}{reply.text}")
                print(line, file=sys.stdout if reply.ok else sys.stderr, flush=True)
    if arguments.json:
        told = replies[0] if len(arguments.ids) == 1 else replies
        print(msgspec.json.format(msgspec.json.encode(told), indent=2).decode())
    return OK if all(reply.ok for reply in replies) else FAILED


def _ids(text: str) -> list[int]:
    """Ids as :func:`.id_list` takes them; none for ``all``."""
    return [] if text == "all" else id_list(text)


def _check_id(servos: list[int], wanted: int, bus: BusConfig) -> None:
    """Two servos of one id answer at once and can no longer be told apart, nor renamed."""
    if len(servos) > 1:
        raise _BadUsage("an id is for one servo only")
    if wanted not in servos and wanted in bus.ids():
        raise _BadUsage(f"id {wanted} is taken: robot.toml lists another servo with it on this bus")


def _parser() -> argparse.ArgumentParser:
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("ids", type=_ids, metavar="IDS", help="5, or 1-4,7, or all")
    common.add_argument("--bus", metavar="B", help="which bus, if there are several")
    common.add_argument("--json", action="store_true", help="print the answer as JSON")
    add_config(common)
    parser = argparse.ArgumentParser(
        prog="wackel servo",
        description="Pings, reads, writes or reboots servos of a running robot.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    operations = parser.add_subparsers(dest="operation", required=True, metavar="OPERATION")
    operations.add_parser("ping", parents=[common], help="whether it answers, and its model number")
    operations.add_parser("reboot", parents=[common], help="restart it: clears a hardware error")
    read = operations.add_parser("read", parents=[common], help="read a register")
    read.add_argument("register", metavar="REGISTER", help="name, such as present_position")
    write = operations.add_parser("write", parents=[common], help="write a register")
    write.add_argument("register", metavar="REGISTER", help="name, such as return_delay_time")
    write.add_argument("value", metavar="VALUE", type=int, help="raw value")
    reset = operations.add_parser("factory-reset", parents=[common], help="erase its settings")
    reset.add_argument("--yes", action="store_true", help="yes, erase them")
    return parser


def _only_bus(config: RobotConfig) -> str:
    if len(config.buses) == 1:
        return next(iter(config.buses))
    known = f"there are {', '.join(config.buses)}" if config.buses else "robot.toml lists none"
    raise _BadUsage(f"say which bus with --bus; {known}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
