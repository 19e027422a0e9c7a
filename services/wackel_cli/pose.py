"""``wackel pose``: where the robot takes itself to be; tell it where it is."""

import argparse
import math
import re
import sys
from collections.abc import Iterator

import msgspec

from wackel_cli.lines import printable
from wackel_node.arguments import add_config, config_of
from wackel_node.errors import FAILED, OK
from wackel_node.link import Link
from wackel_schemas import keys
from wackel_schemas.drive import Odometry, OdometryRequest

_NUMBERS = 9  # of a covariance
_NEGATIVE = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")
_EPILOG = """\
examples:
  wackel pose
  wackel pose reset                 here is the origin, ahead the x axis
  wackel pose set 1.2 -0.5 1.5708   at x and y in m, heading in rad
  wackel pose set 0 0 0 --position-sigma 0.01 --heading-sigma 0.02

exit codes: 0 the pose is known (or done), 1 it is not (or refused), 2 wrong
usage, 3 no robot reached
"""


def main(argv: list[str]) -> int:
    """Asks the odometry; returns the exit code."""
    arguments = _parse(argv)
    request = OdometryRequest()
    if arguments.operation == "reset":
        request = OdometryRequest(operation="reset")
    elif arguments.operation == "set":
        x, y, theta = arguments.pose
        request = OdometryRequest(
            operation="set_pose",
            x=x,
            y=y,
            theta=theta,
            position_sigma=arguments.position_sigma,
            heading_sigma=arguments.heading_sigma,
        )
    with Link(config_of(arguments)) as link:
        try:
            reply = link.ask(keys.ODOMETRY_REQUEST, request)
        except TimeoutError as error:
            raise link.unanswered("odometry") from error
    latest, done = reply.odometry, reply.ok
    if request.operation == "get":
        done = latest is not None and latest.valid
    if arguments.json:
        print(msgspec.json.format(msgspec.json.encode(reply), indent=2).decode())
    elif request.operation == "get" and latest is not None:
        print("\n".join(map(printable, as_lines(latest))))
    else:
        print(printable(reply.text), file=sys.stdout if done else sys.stderr)
    return OK if done else FAILED


def as_lines(odometry: Odometry) -> Iterator[str]:
    """Pose, how well it is known, motion, and what is not believed."""
    yield f"at {odometry.x:+.3f} m {odometry.y:+.3f} m, heading {_angle(odometry.theta)}"
    if not odometry.valid:
        yield f"not known: {odometry.reason}"
    elif len(odometry.pose_covariance) == _NUMBERS:
        xx, yy, tt = (max(each, 0.0) for each in odometry.pose_covariance[:: _NUMBERS // 2])
        heading = math.degrees(math.sqrt(tt))
        yield f"known within {math.sqrt(xx + yy):.3f} m and {heading:.2f}°, one sigma"
    if odometry.valid and odometry.standing:
        yield "stands"
    elif odometry.valid:
        yield (
            f"goes {odometry.vx:+.3f} m/s ahead and {odometry.vy:+.3f} m/s to the left, turns by "
            f"{_angle(odometry.omega)} a second"
        )
    for each in odometry.inputs:
        if each.result != "used":
            yield f"{each.result}: {each.name}"
    for exclusion in odometry.excluded:
        yield f"{exclusion.component} is excluded: {exclusion.reason}"


def _angle(value: float) -> str:
    return f"{value:+.4f} rad ({math.degrees(value):+.1f}°)"


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="wackel pose",
        description="Shows where the robot takes itself to be, or tells it where it is.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "operation",
        nargs="?",
        default="show",
        choices=["show", "reset", "set"],
        metavar="OPERATION",
        help="show (default), reset or set",
    )
    parser.add_argument(
        "pose", nargs="*", type=float, metavar="X Y THETA", help="of set: m, m, rad"
    )
    parser.add_argument(
        "--position-sigma",
        metavar="M",
        type=float,
        default=0.0,
        help="how well x and y are known (exactly)",
    )
    parser.add_argument(
        "--heading-sigma",
        metavar="RAD",
        type=float,
        default=0.0,
        help="how well the heading is (exactly)",
    )
    parser.add_argument("--json", action="store_true", help="print the answer as JSON")
    add_config(parser)
    parser._negative_number_matcher = _NEGATIVE  # what it knows of them lacks exponents
    arguments = parser.parse_intermixed_args(argv)
    wanted = 3 if arguments.operation == "set" else 0
    if len(arguments.pose) != wanted:
        parser.error("set takes X Y THETA" if wanted else f"{arguments.operation} takes no numbers")
    return arguments


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
