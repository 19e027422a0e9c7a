"""``wackel health``: what the robot suffers from now; acknowledge it, or forget what has healed."""

import argparse
import sys
from typing import Literal

import msgspec
from rich.console import Console
from rich.text import Text

from wackel_cli.lines import printable
from wackel_node.arguments import add_config, config_of
from wackel_node.errors import FAILED, OK
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.component import in_words
from wackel_schemas.health import FaultRecord, Health, HealthRequest

_EPILOG = """\
examples:
  wackel health
  wackel health && start-walking    in scripts: 0 only if all is well
  wackel health ack                 everything has been seen
  wackel health ack cable_break bus/main/cable/3-7
  wackel health clear               forget all that has healed; the rest stays

exit codes: 0 all well (or done), 1 not well (or refused), 2 wrong usage,
3 no robot reached
"""
_OPERATIONS: dict[str, Literal["get", "acknowledge", "clear"]] = {
    "show": "get",
    "ack": "acknowledge",
    "clear": "clear",
}
_LABEL = 10  # columns before what is said
_STYLES = {"confirmed": "red", "pending": "yellow", "unknown": "yellow", "healed": "green"}


def main(argv: list[str]) -> int:
    """Asks the aggregator; returns the exit code."""
    arguments = _parse(argv)
    operation = _OPERATIONS[arguments.operation]
    request = HealthRequest(operation=operation, code=arguments.code, component=arguments.component)
    with Link(config_of(arguments)) as link:
        try:
            reply = link.ask(keys.HEALTH_REQUEST, request)
        except TimeoutError as error:
            raise link.unanswered("aggregator") from error
    health = reply.health
    if arguments.json:
        print(msgspec.json.format(msgspec.json.encode(reply), indent=2).decode())
    elif operation == "get" and health is not None:
        console = Console(highlight=False, soft_wrap=True)
        text = as_text(health)
        console.print(folded(text, console) if console.is_terminal else text)
    else:
        print(printable(reply.text), file=sys.stdout if reply.ok else sys.stderr)
    if operation == "get":
        return OK if health is not None and health.level == "ok" else FAILED
    return OK if reply.ok else FAILED


def as_text(health: Health) -> Text:
    """Summary, faults with remedies, and services that are not ready or have more to say."""
    lines = [Text(health.summary, style="bold")]
    for fault in health.faults:
        lines += _fault_lines(fault)
    for service in health.services:
        if service.status != "ready" or service.reason:
            reason = f": {service.reason}" if service.reason else ""
            lines.append(Text(f"{service.status:<{_LABEL}}{service.name}{reason}", style="yellow"))
    for line in lines:
        line.plain = printable(line.plain)  # summaries, messages and remedies come from the network
    return Text("\n").join(lines)


def folded(text: Text, console: Console) -> Text:
    """The text of :func:`as_text` in a terminal's width; what is folded goes on below itself."""
    summary, *lines = text.split("\n")
    shown = [*summary.wrap(console, console.width)]
    for line in lines:
        label, said = line.divide([_LABEL])
        first, *rest = said.wrap(console, max(1, console.width - _LABEL))
        shown += [label + first, *(Text(" " * _LABEL) + part for part in rest)]
    for line in shown:
        line.rstrip()
    return Text("\n").join(shown)


def _fault_lines(fault: FaultRecord) -> list[Text]:
    told = [
        Text(f"{fault.status:<{_LABEL}}", style=_STYLES[fault.status]).append(
            fault.message, "default"
        ),
        Text(f"{'':{_LABEL}}{fault.code} {fault.component}", style="dim"),
    ]
    if fault.confidence < 1:
        told[-1].append(f", {fault.confidence:.0%} sure")
    if fault.acknowledged:
        told[-1].append(", acknowledged")
    if fault.occurrences > 1:
        told[-1].append(f", {fault.occurrences} times")
    if fault.inhibited_by:
        told[-1].append(f", follows from {fault.inhibited_by}")
    if fault.status != "healed":
        if fault.suspects:
            others = "; ".join(map(in_words, fault.suspects))
            told.append(Text(f"{'':{_LABEL}}It may also be {others}.", style="dim"))
        if fault.evidence is not None:
            told.append(Text(f"{'':{_LABEL}}Evidence: {fault.evidence.summary}.", style="dim"))
        told.append(Text(f"{'':{_LABEL}}→ {fault.remedy}"))
    return told


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="wackel health",
        description="Shows the robot's health with every fault and its remedy.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "operation",
        nargs="?",
        default="show",
        choices=_OPERATIONS,
        metavar="OPERATION",
        help="show (default), ack or clear",
    )
    parser.add_argument("code", nargs="?", default="", metavar="CODE", help="only this fault, …")
    parser.add_argument("component", nargs="?", default="", metavar="COMPONENT", help="… there")
    parser.add_argument("--json", action="store_true", help="print the answer as JSON")
    add_config(parser)
    arguments = parser.parse_args(argv)
    if arguments.operation == "show" and arguments.code:
        parser.error("show takes no fault; ack and clear do")
    if arguments.code and not arguments.component:
        parser.error(f"{arguments.code} where? Its component is missing")
    return arguments


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
