"""The one table of subcommands: where each lives and what it is for."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Command:
    """A subcommand.

    Attributes:
        module: Has ``main(argv: list[str]) -> int``; imported only when the command runs.
        help: One line.
    """

    module: str
    help: str


GROUPS: dict[str, dict[str, Command]] = {
    "Run a robot": {
        "up": Command("wackel_cli.up", "run everything in robot.toml, restart what dies"),
        "virtual": Command("wackel_virtual.__main__", "a virtual robot, with faults at will"),
        "pilot": Command("wackel_pilot.__main__", "drive a robot with wheels along a path"),
        "demo": Command("wackel_cli.demo", "see faults injected, named and healed; no hardware"),
        "paper": Command("wackel_cli.paper", "repeat the paper's experiment on a blocked wheel"),
    },
    "Look at it": {
        "top": Command("wackel_cli.top", "live view of buses, servos and faults"),
        "health": Command("wackel_cli.health", "what is wrong and what to do; acknowledge, clear"),
        "pose": Command("wackel_cli.pose", "where the robot is; tell it where it is"),
        "view": Command("wackel_view.__main__", "show the robot in a Foxglove viewer"),
        "echo": Command("wackel_cli.echo", "print what is published on a topic"),
        "record": Command("wackel_recorder.__main__", "record all topics into an MCAP file"),
        "play": Command("wackel_playback.__main__", "publish a recording in the robot's place"),
        "replay": Command("wackel_cli.replay", "diagnose a recording as fast as it goes"),
    },
    "Set it up": {
        "scan": Command("wackel_gateway.scan", "find servos and write a robot.toml"),
        "servo": Command("wackel_cli.servo", "ping, read, write or reboot servos"),
        "doctor": Command("wackel_cli.doctor", "check what is most often wrong on a computer"),
        "explain": Command("wackel_diagnoser.explain", "which drive faults can be told apart"),
        "calibrate": Command("wackel_cli.calibrate", "wheels' measures, from a true path"),
        "config": Command("wackel_cli.config", "check robot.toml and print it with all defaults"),
        "schema": Command("wackel_cli.schema", "JSON Schemas of all messages"),
    },
    "Single services (wackel up runs them for you)": {
        "gateway": Command("wackel_gateway.__main__", "own a servo bus and publish its traffic"),
        "imu": Command("wackel_imu.__main__", "read a gyro of this computer (Linux IIO)"),
        "classifier": Command("wackel_classifier.__main__", "name bus faults from raw traffic"),
        "diagnoser": Command("wackel_diagnoser.__main__", "name faulty drives and steerings"),
        "odometry": Command("wackel_odometry.__main__", "pose and twist from wheels and gyros"),
        "aggregator": Command("wackel_aggregator.__main__", "merge all faults into one health"),
    },
}

COMMANDS: dict[str, Command] = {
    name: command for group in GROUPS.values() for name, command in group.items()
}
