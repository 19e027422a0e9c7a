"""``wackel explain``: which drive faults this robot can tell apart, and which motion would tell."""

import argparse
import json
import math
import sys

from wackel_node.algebra import single_threaded
from wackel_node.arguments import DEFAULT, add_config_first
from wackel_node.config import RobotConfig, drive_of, load

_UNKNOWNS = 3  # of a twist


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel explain",
        description="Says which faults of the drive in robot.toml can be told apart with its "
        "geometry and sensors, which look alike, and which motion would tell.",
        epilog="Asked of the diagnoser's own arithmetic, with typical faults: a wheel 20 % slow, a "
        "steering 5° off, a gyro off by 0.1 rad/s, at 0.5 m/s.",
    )
    add_config_first(parser)
    parser.add_argument(
        "--json",
        action="store_true",
        help="one JSON object a fault: component, whether commanded (by command/twist), and for "
        "each of the motions seen_s, the time to the alarm in s (null: never), and like, the "
        "components that explain it as well",
    )
    arguments = parser.parse_args(argv)
    config = load(arguments.config or DEFAULT)
    drive_of(config, "see which of their faults can be told apart")
    single_threaded()
    for line in _json(config) if arguments.json else _text(config):
        print(line)
    return 0


def _json(config: RobotConfig) -> list[str]:
    return [
        json.dumps(
            {
                "component": fault,
                "commanded": commanded,
                "motions": {
                    motion: {
                        "seen_s": round(seen_s, 3) if math.isfinite(seen_s) else None,
                        "like": list(like),
                    }
                    for motion, (seen_s, like) in seen.items()
                },
            }
        )
        for commanded in (True, False)
        for fault, seen in _visibility(config, commanded=commanded).items()
    ]


def _text(config: RobotConfig) -> list[str]:
    lines = []
    for commanded, condition in (
        (True, "While command/twist says what the wheels should do:"),
        (False, "Where nobody publishes that:"),
    ):
        lines.append(condition)
        for fault, seen in _visibility(config, commanded=commanded).items():
            lines += [f"  {line}" for line in _of_fault(fault, seen)]
        lines.append("")
    return [*lines, *_notes(config)]


def _of_fault(fault: str, seen: dict[str, tuple[float, tuple[str, ...]]]) -> list[str]:
    """Whether a fault is named in each motion, or what it looks like."""
    from wackel_diagnoser.isolability import SEEN_S
    from wackel_schemas import component

    name = component.in_words(fault)
    lines = [name[0].upper() + name[1:]]
    shows = {motion: like for motion, (seen_s, like) in seen.items() if seen_s <= SEEN_S}
    clear = [motion for motion, like in shows.items() if not like]
    if clear:
        lines.append(f"  is named in {', '.join(clear)}")
    by_likeness: dict[tuple[str, ...], list[str]] = {}
    for motion, like in shows.items():
        if like:
            by_likeness.setdefault(like, []).append(motion)
    for like, motions in by_likeness.items():
        alike = " or ".join(component.in_words(each) for each in like)
        tell = f"{clear[0]} would tell" if clear else "no motion tried would tell"
        lines.append(f"  looks like {alike} in {', '.join(motions)}; {tell}")
    hidden = [motion for motion in seen if motion not in shows]
    if hidden:
        lines.append(f"  does not show in {', '.join(hidden)}")
    return lines


def _notes(config: RobotConfig) -> list[str]:
    """What no motion changes."""
    from wackel_diagnoser.efforts import LONG_S

    assert config.drive is not None
    steered = any(wheel.steering is not None for wheel in config.drive.wheels)
    notes = ["Whatever the motion:"]
    if config.gyros:
        notes.append("  a sensor is told from what it measures by gyro and motor currents")
    else:
        notes.append(
            "  without a gyro only motor currents tell a sensor from what it measures; list one "
            "under [gyros]"
        )
    notes.append(
        "  a wheel that rolls freely looks sound: it shows if its servo reports torque off, or if "
        "its current stays that of a motor alone while the others hasten and slow down; creeping "
        f"along does not tell, and {LONG_S:.0f} s of driving must have shown what is usual"
    )
    notes.append("  a wheel on ice does not show while the others hold the robot on its way")
    if steered:
        notes.append("  a steering that is blocked shows once it is told to turn")
        notes.append(
            "  half a degree between a steering and where it should stand is told, but not whether "
            "it stands off or shows a wrong angle"
        )
        notes.append(
            "  a steering whose zero is wrong forces the robot aside; gyro and wheels show that "
            "after some seconds of turns, later the more wheels there are and the stiffer their "
            "drives and tyres"
            if config.gyros
            else "  a steering whose zero is wrong does not show without a gyro"
        )
    return notes + [f"  {note}" for note in _notes_on_two(config, steered=steered)]


def _notes_on_two(config: RobotConfig, *, steered: bool) -> list[str]:
    """Which faults that come together are not told apart."""
    assert config.drive is not None
    notes = ["of two faults at once, both are named while command/twist says what wheels should do"]
    if config.drive.kind == "steered":
        spare = 2 * len(config.drive.wheels) + len(config.gyros) - _UNKNOWNS
        spoilt = {"drives": 1, "steerings": 2}  # of a wheel's two rows
        alike = [part for part, rows in spoilt.items() if spare - 2 * rows < 1]
    else:
        alike = ["parts"]
    notes += [
        f"where nobody publishes that, two faulty {part} leave too few measurements that agree: "
        "which two they are cannot be told"
        for part in alike
    ]
    if steered:
        notes.append(
            "a fault of the steering of a wheel that is blocked, or shows no speed, is mostly "
            "named only once that is repaired"
        )
        notes.append(
            "a motor that turns about as it is told is mostly not accused while another wheel is "
            "blocked or its steering stands off: what that makes the other wheels slip hides it "
            "until it is repaired"
        )
    if config.gyros:
        notes.append(
            "a gyro that jumps is not accused beside a wheel: one that is dragged turns the robot "
            "by as much, until it is repaired"
        )
    return notes


def _visibility(
    config: RobotConfig, *, commanded: bool
) -> dict[str, dict[str, tuple[float, tuple[str, ...]]]]:
    """Time to the alarm and what looks alike, by fault and motion."""
    from wackel_diagnoser.isolability import Isolability

    assert config.drive is not None
    isolability = Isolability(config.drive, config.gyros, commanded=commanded)
    motions = isolability.motions()
    result: dict[str, dict[str, tuple[float, tuple[str, ...]]]] = {}
    for fault in isolability.faults():
        seen = {motion: isolability.look(fault, twist) for motion, twist in motions.items()}
        result[fault] = {motion: (each.seen_s, each.like) for motion, each in seen.items()}
    return result


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
