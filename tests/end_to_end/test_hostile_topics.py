"""Whatever strangers publish: no service dies, no output has a NaN, health says why.

A robot with wheels runs on the virtual bus, with all its services and a view; everything in
:mod:`tests.end_to_end.hostility` comes on every topic and every query while it works.
"""

import json
import math
from collections import defaultdict
from pathlib import Path

import msgpack
import msgspec
import pytest
import zenoh
from zenoh.handlers import Callback

from tests import robot as robots
from tests.end_to_end import hostility
from tests.end_to_end.command import wackel
from tests.odometry.simulation import differential_drive
from wackel_node.config import RecorderConfig, RobotConfig
from wackel_node.config_drive import GyroConfig
from wackel_node.listen import EVERYTHING, listen
from wackel_schemas.health import Health
from wackel_schemas.keys import QUERIES, TOPICS, topic_of

pytestmark = pytest.mark.process

LIMIT_S = 60.0
_UNCONCERNED = ("virtual/main", "recorder/main")
"""One listens to no topic, the other takes whatever comes."""
_PAUSE_EVERY = 25
"""Messages at a time: nobody's inbox shall overflow, so that every message is looked at."""


def wheeled(directory: Path) -> RobotConfig:
    config: RobotConfig = msgspec.structs.replace(
        robots.chain(directory, 4),
        drive=differential_drive(),
        gyros={"body": GyroConfig()},
        recorder=RecorderConfig(directory=str(directory / "recordings")),
    )
    return config


class Outsider:
    """Publishes anything, and watches what services say."""

    def __init__(self, robot: robots.Robot) -> None:
        self.robot = robot
        self.said: dict[str, int] = defaultdict(int)  # sound messages of services, by topic
        self.no_numbers: list[str] = []
        self.health: list[Health] = []
        self._prefix = f"wackel/{robot.link.config.robot}/"
        listen(robot.link, [EVERYTHING], self._look)

    def _look(self, key: str, payload: bytes) -> None:
        topic = topic_of(key)
        if topic is None:
            return
        try:
            message = msgpack.unpackb(payload, strict_map_key=False)
            if message["boot"] == hostility.STRANGER:
                return
        except (ValueError, TypeError, KeyError, msgpack.exceptions.UnpackException):
            return  # of a stranger
        self.said[topic.pattern] += 1
        if not _all_numbers(message):
            self.no_numbers.append(f"{key}: {message}"[:500])

    def publish(self, key: str, payload: bytes) -> None:
        self.robot.link.session.put(
            self._prefix + key, payload, congestion_control=zenoh.CongestionControl.BLOCK
        )

    def ask(self, key: str, payload: bytes) -> list[zenoh.Reply]:
        replies: list[zenoh.Reply] = []
        done: list[bool] = []
        self.robot.link.session.get(
            self._prefix + key,
            Callback(replies.append, drop=lambda: done.append(True), indirect=False),
            payload=payload,
            timeout=10.0,
        )
        self.robot.wait(lambda: bool(done))
        return replies

    def reasons(self) -> str:
        """What health has said so far of messages that were of no use."""
        return "\n".join(
            f"{fault.component} {fault.code}: {fault.message}"
            for heard in self.robot.heard
            for fault in heard.health.faults
            if fault.code in ("messages_refused", "bad_input")
        )


def _all_numbers(value: object) -> bool:
    match value:
        case float():
            return math.isfinite(value)
        case dict():
            return all(map(_all_numbers, value.values()))
        case list():
            return all(map(_all_numbers, value))
    return True


def test_there_is_something_hostile_for_every_topic_and_query() -> None:
    assert hostility.uncovered() == set()


def test_nothing_on_any_topic_harms_the_services(tmp_path: Path) -> None:
    config = wheeled(tmp_path)
    with (
        robots.running(config, tmp_path) as robot,
        robots.process(
            "wackel_cli",
            "view",
            "--config",
            str(tmp_path / "robot.toml"),
            "--port",
            "0",
            log=tmp_path / "view.log",
        ) as view,
    ):
        robot.wait(robot.ready, LIMIT_S)
        outsider = Outsider(robot)
        robot.wait(lambda: outsider.said["odometry"] > 20, LIMIT_S)
        pids = robot.pids()
        for topic in TOPICS:
            _attack(outsider, topic.pattern, hostility.keys_of(topic))
        for query in QUERIES:
            _interrogate(outsider, query.pattern, hostility.keys_of(query)[0])
        reasons = outsider.reasons()
        for service in pids:
            if service not in _UNCONCERNED:
                assert f"service/{service} messages_refused" in reasons, reasons
        for component in ("bus/main/servo/1", "gyro/body", "command"):
            assert f"{component} bad_input" in reasons, reasons

        # Everyone goes on, and forgets.
        before = dict(outsider.said)
        healed: set[str] = set()
        robot.wait(lambda: _forgotten(robot.health, healed), LIMIT_S)
        assert all(robot.status(service) == "ready" for service in pids)
        for pattern in ("bus/{bus}/state", "bus/{bus}/transaction", "odometry", "health"):
            robot.wait(lambda pattern=pattern: outsider.said[pattern] > before[pattern] + 5)  # type: ignore[misc]
        assert robot.pids() == pids
        assert robot.up.poll() is None
        assert view.poll() is None
        assert outsider.no_numbers == []
    _replay(tmp_path)
    log = (tmp_path / "up.log").read_text() + (tmp_path / "view.log").read_text()
    assert "Traceback" not in log


def _replay(directory: Path) -> None:
    """All of it is recorded, and what follows from it is the same twice."""
    written = []
    for name in ("first", "second"):
        faults, odometry = directory / f"{name}.faults", directory / f"{name}.odometry"
        recordings = (directory / "recordings").iterdir()
        done = wackel("replay", *recordings, "-o", faults, "--odometry", odometry)
        assert done.returncode == 0, done.stderr[-2000:]
        assert "messages not used" in done.stderr
        written.append(faults.read_text() + odometry.read_text())
    assert written[0] == written[1]
    for line in written[0].splitlines():
        json.loads(line, parse_constant=pytest.fail)


def _forgotten(health: Health, healed: set[str]) -> bool:
    """Whether no refusal is left; for one of the bus it is enough to have healed once, which is
    kept, since late answers of a busy computer make it anew."""
    refusals = [f for f in health.faults if f.code in ("messages_refused", "bad_input")]
    active = {f.component for f in refusals if f.status != "healed"}
    healed.update(f.component for f in refusals if f.status == "healed")
    return bool(refusals) and active <= {"bus/main"} & healed


def _attack(outsider: Outsider, pattern: str, keys: list[str]) -> None:
    robot = outsider.robot
    sent = 0

    def send(key: str, payload: bytes) -> None:
        nonlocal sent
        outsider.publish(key, payload)
        sent += 1
        if sent % _PAUSE_EVERY == 0:
            robot.listen(0.05)

    now_ns = robot.link.clock.now_ns
    for key in keys:
        for payload in hostility.garbage():
            send(key, payload)
        for message in hostility.nonsense(pattern, now_ns()):
            send(key, msgpack.packb(message))
    if pattern in hostility._SOUND:
        for message in hostility.back_in_time(pattern, now_ns()):
            send(keys[0], msgpack.packb(message))
    robot.listen(0.6)  # a heartbeat, which tells the reason


def _interrogate(outsider: Outsider, pattern: str, key: str) -> None:
    for payload in hostility.garbage():
        replies = outsider.ask(key, payload)
        assert not replies or replies[0].err is not None or _all_defaults(payload), payload[:40]
    for request in hostility.requests(pattern):
        replies = outsider.ask(key, msgpack.packb(request))
        assert replies, f"no answer to {str(request)[:100]}"
        for reply in replies:
            if reply.ok is not None:
                assert msgpack.unpackb(reply.ok.payload.to_bytes())["ok"] in (False, True)


def _all_defaults(payload: bytes) -> bool:
    """Whether a request says nothing, or only what nobody knows: some may be answered."""
    return not payload or payload[0] in range(0x80, 0x90)  # an empty map, or a small one
