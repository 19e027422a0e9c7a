"""``wackel echo``: what is published, as it is published."""

import argparse
import sys
import time

import msgspec

from wackel_cli.lines import as_json, as_text, clock_time, printable
from wackel_cli.rates import Rate, Rates
from wackel_node.arguments import add_config, config_of, count
from wackel_node.errors import OK
from wackel_node.link import Link
from wackel_node.listen import EVERYTHING, header_of, key_expression, listen

_PERIOD_S = 1.0
_SILENCE_S = 3.0
_EXAMPLES = """\
examples:
  wackel echo health
  wackel echo 'bus/*/state' 'fault/*' --json
  wackel echo --hz                  who publishes how often, and what is lost
"""


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    arguments = _parser().parse_args(argv)
    for pattern in arguments.patterns:
        key_expression(pattern)
    show = _Reports if arguments.hz else _Messages
    with Link(config_of(arguments)) as link:
        shown = show(link, arguments.json, arguments.count)
        listen(link, arguments.patterns, shown.take)
        silent_at = time.monotonic() + _SILENCE_S
        try:
            while shown.left > 0:
                link.pump(0.5)
                if not shown.received and time.monotonic() > silent_at:
                    silent_at = float("inf")
                    print(f"nothing comes yet on {' '.join(arguments.patterns)}", file=sys.stderr)
        except KeyboardInterrupt:
            return OK
    return OK


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="wackel echo",
        description="Prints what is published below the robot's name, one line a message, until\n"
        "Ctrl-C. The latest health comes at once.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "patterns",
        metavar="KEY",
        nargs="*",
        default=[EVERYTHING],
        help="key expression below the robot's name: bus/*/state, ** (default: everything)",
    )
    add_config(parser)
    parser.add_argument("--json", action="store_true", help="JSON lines; bytes are base64")
    parser.add_argument(
        "--hz", action="store_true", help="rates, intervals and losses, once a second"
    )
    parser.add_argument(
        "-n",
        "--count",
        type=count,
        default=float("inf"),
        metavar="N",
        help="end after so many messages (with --hz: after so many seconds)",
    )
    return parser


class _Messages:
    """Prints each message.

    Attributes:
        left: How many are still to be printed.
        received: Whether any came.
    """

    def __init__(self, link: Link, json: bool, left: float) -> None:
        self.left = left
        self.received = False
        self._link = link
        self._json = json

    def take(self, key: str, payload: bytes) -> None:
        self.received = True
        if self.left == 0:
            return
        self.left -= 1
        if self._json:
            print(as_json(key, payload), flush=True)
            return
        header = header_of(key, payload)
        stamp_ns = self._link.clock.now_ns() if header is None else header.stamp
        print(f"{clock_time(stamp_ns)}  {printable(key)}  {as_text(key, payload)}", flush=True)


class _Reports:
    """Prints rates once a second; attributes as :class:`_Messages`, counting reports."""

    def __init__(self, link: Link, json: bool, left: float) -> None:
        self.left = left
        self.received = False
        self._link = link
        self._json = json
        self._rates = Rates()
        self._since_s = time.monotonic()
        link.every(_PERIOD_S, self._report)

    def take(self, key: str, payload: bytes) -> None:
        self.received = True
        now_s = time.monotonic()
        self._rates.add(
            key, len(payload), header_of(key, payload), now_s, self._link.clock.now_ns()
        )

    def _report(self) -> None:
        now_s = time.monotonic()
        rates = self._rates.take(now_s - self._since_s)
        self._since_s = now_s
        if not rates or self.left == 0:
            return
        self.left -= 1
        if self._json:
            print("\n".join(msgspec.json.encode(rate).decode() for rate in rates), flush=True)
        else:
            print(table(rates), end="\n\n", flush=True)


def table(rates: list[Rate]) -> str:
    """Rates in columns."""
    width = max(3, *(len(rate.key) for rate in rates))
    lines = [f"{'key':<{width}}  {'Hz':>8}  {'interval ms':>15}  {'age ms':>8}  {'kB/s':>7}  lost"]
    for rate in rates:
        interval = (
            "-"
            if rate.shortest_s is None or rate.longest_s is None
            else f"{rate.shortest_s * 1e3:.1f} … {rate.longest_s * 1e3:.1f}"
        )
        age = "-" if rate.age_s is None else f"{rate.age_s * 1e3:.1f}"
        lines.append(
            f"{printable(rate.key):<{width}}  {rate.hz:8.1f}  {interval:>15}  {age:>8}  "
            f"{rate.bytes_per_s / 1e3:7.1f}  {rate.lost}"
        )
    return "\n".join(lines)
