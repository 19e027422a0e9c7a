"""``wackel virtual``: a virtual robot on real serial ports, and faults at will."""

import argparse
import difflib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from wackel_node import log
from wackel_node.algebra import single_threaded
from wackel_node.arguments import above_zero, add_config, config_of
from wackel_node.config import drive_of
from wackel_node.errors import FAILED, OK, USAGE, Explained

if TYPE_CHECKING:
    from wackel_node.config import RobotConfig
    from wackel_node.link import Link
    from wackel_schemas.virtual import Injection
    from wackel_virtual.faults import Kind

_RUN = """\
Runs a virtual robot: every bus of robot.toml as a pseudo-terminal at its port's
path, with servos that answer as real ones do, in real time. Any Dynamixel
software can open it. Without robot.toml there are 12 XM430-W210 with the ids
1 to 12 at 1 Mbit/s on ./wackel-bus. With [drive] the servos move wheels on a
floor, and gyros of source "topic" are published.

While it runs, from another terminal:
  wackel virtual inject KIND ...   break something
  wackel virtual heal [KIND] ...   repair it
  wackel virtual list              what is broken now
  wackel virtual kinds             everything that can break
Each of them explains itself with --help.
"""
_RUN_EXAMPLES = """\
examples:
  wackel virtual
  wackel virtual --config robot.toml --seed 3
  wackel virtual --scenario broken-cable.toml
  wackel virtual --tap main=wackel-tap
  wackel virtual --no-zenoh      only the ports, for other software
"""
_START = "`wackel up --virtual` or `wackel virtual`"
_INJECT_EXAMPLES = """\
examples:
  wackel virtual inject break --servo 5
  wackel virtual inject loose_contact --servo 5 --value 8 --for 20
  wackel virtual inject noise --value 1e-5
  wackel virtual inject wheel_blocked --wheel left --for 5
"""


class WrongOrder(Explained, ValueError):
    """Options stand before the word that says what to do."""

    exit_code = USAGE


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    match argv:
        case ["inject", *rest]:
            return _inject(rest)
        case ["heal", *rest]:
            return _heal(rest)
        case ["list", *rest]:
            return _list(rest)
        case ["kinds", *rest]:
            return _kinds(rest)
    for word in ("inject", "heal", "list", "kinds"):
        if word in argv[1:]:
            raise WrongOrder(f"begin with the word: wackel virtual {word} ...; options follow it")
    return _run(argv)


def _run(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="wackel virtual",
        description=_RUN,
        epilog=_RUN_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_config(parser)
    parser.add_argument(
        "--scenario", metavar="FILE", type=Path, help="a robot, and what goes wrong with it when"
    )
    parser.add_argument(
        "--seed", type=int, help="of everything random (default: that of the scenario, else 0)"
    )
    parser.add_argument(
        "--physics",
        choices=["fast", "mujoco"],
        help="of the drive: without contacts, or MuJoCo (default: that of the scenario, else fast)",
    )
    parser.add_argument(
        "--truth",
        metavar="CSV",
        type=Path,
        help="write where the robot really is, for `wackel calibrate` (needs [drive])",
    )
    parser.add_argument(
        "--no-zenoh", action="store_true", help="do not listen for inject, heal and list"
    )
    parser.add_argument(
        "--tap",
        metavar="BUS=PATH",
        type=_tap,
        action="append",
        default=[],
        help="a second port on this bus that hears both directions and sends nothing (mode tap)",
    )
    arguments = parser.parse_args(argv)
    if arguments.config is not None and arguments.scenario is not None:
        parser.error("--config and --scenario exclude each other; a scenario names its robot")
    taps = dict(arguments.tap)
    if len(taps) < len(arguments.tap):
        parser.error("--tap: a bus has at most one")
    log.set_up("virtual")

    import msgspec

    single_threaded()
    from wackel_virtual.scenario import load_scenario, of_robot, tapped
    from wackel_virtual.service import run, run_alone

    if arguments.scenario is not None:
        scenario = load_scenario(arguments.scenario)
    else:
        scenario = of_robot(config_of(arguments))
    if arguments.seed is not None:
        scenario = msgspec.structs.replace(scenario, seed=arguments.seed)
    if arguments.physics is not None:
        scenario = msgspec.structs.replace(scenario, physics=arguments.physics)
    if taps:
        scenario = tapped(scenario, taps, "--tap")
    if arguments.truth is not None:
        drive_of(scenario.config, "have a true path")
    (run_alone if arguments.no_zenoh else run)(scenario, arguments.truth)
    return OK


def _tap(text: str) -> tuple[str, str]:
    bus, _, path = text.partition("=")
    if not bus or not path:
        raise argparse.ArgumentTypeError(f"{text!r} must be BUS=PATH, such as main=wackel-tap")
    return bus, path


def _inject(argv: list[str]) -> int:
    from wackel_schemas.virtual import Injection

    parser = argparse.ArgumentParser(
        prog="wackel virtual inject",
        description="Makes a fault on the running virtual robot. `wackel virtual kinds` explains\n"
        "what each KIND does and what its value means.",
        epilog=_INJECT_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("kind", metavar="KIND", type=_kind, help=", ".join(_all_kinds()))
    _add_place(parser)
    parser.add_argument("--value", metavar="X", type=float, help="its strength, by kind")
    parser.add_argument(
        "--after", metavar="S", type=float, default=0.0, help="begin so many seconds from now"
    )
    parser.add_argument(
        "--for",
        metavar="S",
        type=above_zero,
        dest="duration_s",
        help="end after so many seconds (default: when healed)",
    )
    arguments = _parsed(parser, argv)
    injection = Injection(
        kind=arguments.kind,
        bus=arguments.bus,
        servo=arguments.servo,
        wheel=arguments.wheel,
        value=arguments.value,
        start_s=arguments.after,
        duration_s=arguments.duration_s,
    )
    return _ask("inject", injection, arguments)


def _heal(argv: list[str]) -> int:
    from wackel_schemas.virtual import Injection

    parser = argparse.ArgumentParser(
        prog="wackel virtual heal",
        description="Repairs the running virtual robot: all faults, or only those of a kind, a "
        "bus, a servo or a wheel. An alert that a servo has raised stays until it is rebooted.",
    )
    parser.add_argument(
        "kind",
        metavar="KIND",
        nargs="?",
        default="",
        type=_kind,
        help="only this kind",
    )
    _add_place(parser)
    arguments = _parsed(parser, argv)
    wanted = Injection(
        kind=arguments.kind, bus=arguments.bus, servo=arguments.servo, wheel=arguments.wheel
    )
    return _ask("heal", wanted, arguments)


def _list(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="wackel virtual list", description="Lists the faults that are active now."
    )
    return _ask("list", None, _parsed(parser, argv))


def _kinds(argv: list[str]) -> int:
    kinds = _all_kinds()
    parser = argparse.ArgumentParser(
        prog="wackel virtual kinds", description="Explains every kind of fault."
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    if parser.parse_args(argv).json:
        import msgspec

        print(msgspec.json.format(msgspec.json.encode(kinds), indent=2).decode())
        return OK

    import textwrap

    places = {
        "bus": "",
        "servo": " --servo N",
        "cable": " --servo N",
        "bus or servo": " [--servo N]",
        "robot": "",
        "drive": " --wheel W",
        "steering": " --wheel W",
        "any wheel": " [--wheel W]",
    }
    for name, kind in kinds.items():
        print(f"{name}{places[kind.place]}{' [--value X]' if kind.value else ''}")
        text = kind.text
        if kind.default is not None:
            text += f" X: {kind.value}, {kind.least:.4g} to {kind.most:.4g}, else {kind.default:g}."
        print(textwrap.fill(text, 80, initial_indent="    ", subsequent_indent="    "))
    return OK


def _all_kinds() -> "dict[str, Kind]":
    from wackel_virtual.drive_faults import DRIVE_KINDS
    from wackel_virtual.faults import KINDS

    return {**KINDS, **DRIVE_KINDS}


def _kind(text: str) -> str:
    kinds = _all_kinds()
    if text and text not in kinds:
        near = difflib.get_close_matches(text, kinds, n=1)
        hint = f"did you mean {near[0]}?" if near else "`wackel virtual kinds` explains all"
        raise argparse.ArgumentTypeError(f"there is no {text!r}; {hint}")
    return text


def _add_place(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--bus", metavar="B", default="", help="which bus, if there are several")
    parser.add_argument(
        "--servo", metavar="N", type=int, help="id of the servo; of a cable, the one it leads to"
    )
    parser.add_argument("--wheel", metavar="W", help="name of the wheel, for faults of the drive")


def _parsed(parser: argparse.ArgumentParser, argv: list[str]) -> argparse.Namespace:
    add_config(parser)
    parser.add_argument("--json", action="store_true", help="print the answer as JSON")
    return parser.parse_args(argv)


def _ask(
    operation: Literal["inject", "heal", "list"],
    injection: "Injection | None",
    arguments: argparse.Namespace,
) -> int:
    import msgspec

    from wackel_schemas import keys
    from wackel_schemas.virtual import VirtualRequest
    from wackel_virtual.service import in_words

    request = VirtualRequest(operation=operation, injection=injection)
    with _link(config_of(arguments)) as link:
        try:
            reply = link.ask(keys.VIRTUAL_REQUEST, request)
        except TimeoutError as error:
            raise link.unanswered("simulation", _START) from error
    if arguments.json:
        print(msgspec.json.format(msgspec.json.encode(reply), indent=2).decode())
    else:
        print(reply.text)
        for fault in reply.active if operation == "list" else ():
            print(f"  {in_words(fault)}")
    return OK if reply.ok else FAILED


def _link(config: "RobotConfig") -> "Link":
    """To the robot's rendezvous, or, where there is none, to the virtual robot itself."""
    import msgspec

    from wackel_node.link import Link
    from wackel_node.session import NotReached
    from wackel_virtual.service import own_endpoint

    try:
        return Link(config)
    except NotReached as error:
        endpoint = own_endpoint(config)
        if endpoint is None:
            raise
        zenoh = msgspec.structs.replace(config.zenoh, endpoint=endpoint)
        try:
            return Link(msgspec.structs.replace(config, zenoh=zenoh))
        except NotReached:
            raise NotReached(
                f"no virtual robot at {endpoint} and no `wackel up` at {config.zenoh.endpoint}: "
                f"start it with {_START}"
            ) from error


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
