"""``wackel virtual`` as a person uses it."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
import serial

from tests.conftest import Rendezvous, free_port, wait_until
from tests.odometry.simulation import differential_drive
from wackel_node.config import BusConfig, RobotConfig, ServoConfig, ZenohConfig, dump
from wackel_node.config_drive import GyroConfig
from wackel_node.errors import FAILED, NOT_REACHED, OK, USAGE
from wackel_node.link import Link
from wackel_protocols.dynamixel2 import packet
from wackel_schemas import keys
from wackel_schemas.drive import ImuSample
from wackel_schemas.health import Heartbeat
from wackel_virtual.__main__ import main
from wackel_virtual.drive_faults import DRIVE_KINDS
from wackel_virtual.faults import KINDS
from wackel_virtual.service import own_endpoint


@contextmanager
def command(*arguments: str, cwd: Path | None = None) -> "Iterator[subprocess.Popen[str]]":
    line = [sys.executable, "-m", "wackel_virtual", *arguments]
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True, cwd=cwd) as process:
        try:
            yield process
        finally:
            process.kill()  # where a check has failed, it would be waited for in vain


def test_kinds_explains_every_kind(capsys):
    assert main(["kinds"]) == OK
    printed = capsys.readouterr().out
    kinds = {**KINDS, **DRIVE_KINDS}
    assert all(name in printed for name in kinds)
    assert main(["kinds", "--json"]) == OK
    assert json.loads(capsys.readouterr().out).keys() == kinds.keys()


@pytest.mark.parametrize("arguments", [[], ["inject"], ["heal"], ["list"], ["kinds"]])
def test_help_teaches(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*arguments, "--help"])
    assert stop.value.code == OK
    assert "wackel virtual" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["inject", "brake"],
        ["inject"],
        ["inject", "break", "--for", "-5"],
        ["heal", "foo"],
        ["--config", "a", "--scenario", "b"],
        ["--seed", "x"],
        ["--tap", "main"],
        ["--tap", "main=a", "--tap", "main=b"],
    ],
)
def test_wrong_usage_is_refused(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == USAGE
    assert capsys.readouterr().err


def test_a_fault_that_does_not_exist_is_told_with_what_may_be_meant(capsys):
    for arguments, hint in (
        (["inject", "brake"], "there is no 'brake'; did you mean break?"),
        (["heal", "xyz"], "there is no 'xyz'; `wackel virtual kinds` explains all"),
    ):
        with pytest.raises(SystemExit):
            main(arguments)
        assert hint in capsys.readouterr().err


@pytest.mark.process
def test_without_zenoh_it_is_a_serial_port_until_it_is_told_to_stop(tmp_path: Path):
    with command("--no-zenoh", "--seed", "3", cwd=tmp_path) as process:
        port = tmp_path / "wackel-bus"
        wait_until(port.exists)
        with serial.Serial(str(port), 1_000_000, timeout=5) as client:
            client.write(packet.ping(12))
            assert packet.decode(client.read(14)).id == 12
        process.send_signal(signal.SIGTERM)
        assert process.wait(5) == OK
    assert not os.path.lexists(port)


@pytest.mark.process
def test_a_tap_is_a_second_port_that_hears_the_first(tmp_path: Path):
    arguments = ["--no-zenoh", "--tap", "main=wackel-tap"]
    with command(*arguments, cwd=tmp_path) as process:
        port, tap = tmp_path / "wackel-bus", tmp_path / "wackel-tap"
        wait_until(tap.exists)
        with (
            serial.Serial(str(port), 1_000_000, timeout=5) as master,
            serial.Serial(str(tap), 1_000_000, timeout=5) as listener,
        ):
            listener.write(packet.ping(3))  # goes nowhere
            master.write(packet.ping(12))
            answer = master.read(14)
            assert listener.read(24) == packet.ping(12) + answer
            assert packet.decode(answer).id == 12
        process.send_signal(signal.SIGINT)
        assert process.wait(5) == OK
    assert not os.path.lexists(port)
    assert not os.path.lexists(tap)


@contextmanager
def running(config: RobotConfig, directory: Path) -> Iterator[list[str]]:
    """A virtual robot; gives the arguments by which commands reach it."""
    file = directory / "robot.toml"
    bus = f'\n[buses.arm]\nport = "{directory}/arm"\nservos = [{{ id = 1 }}, {{ id = 2 }}]\n'
    file.write_text(dump(config).replace("[buses]\n", "") + bus)
    arguments = ["--config", str(file)]
    with command(*arguments) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.endswith("ready\n"):
                break
        yield arguments
        process.send_signal(signal.SIGINT)
        assert process.wait(5) == OK


@pytest.fixture
def robot(rendezvous: Rendezvous, tmp_path: Path) -> Iterator[list[str]]:
    with running(rendezvous.config, tmp_path) as arguments:
        yield arguments


@pytest.mark.process
def test_a_second_one_is_refused_before_anybody_hears_of_it(robot, rendezvous: Rendezvous):
    beats: list[Heartbeat] = []
    with Link(rendezvous.config) as link:
        link.subscribe(keys.ALIVE, lambda _, beat: beats.append(beat))
        with command(*robot) as second:
            assert second.wait(20) != OK
            assert second.stderr is not None
            assert "another virtual robot runs there" in second.stderr.read()
        heard = len(beats)
        wait_until(lambda: len(beats) > heard, meanwhile=lambda: link.pump(0.05))
    assert {(beat.state, beat.boot) for beat in beats} == {("ready", beats[0].boot)}


@pytest.mark.process
def test_faults_are_injected_listed_and_healed_while_it_runs(robot, capsys):
    assert main(["inject", "break", "--servo", "2", *robot]) == OK
    assert capsys.readouterr().out == "injected break at servo 2 on bus arm\n"
    assert main(["inject", "break", "--servo", "7", *robot]) == FAILED
    assert capsys.readouterr().out == "servo 7 is not on this bus; there are 1, 2\n"
    assert main(["list", *robot]) == OK
    assert capsys.readouterr().out == "1 fault active\n  break at servo 2 on bus arm\n"
    assert main(["list", "--json", *robot]) == OK
    (fault,) = json.loads(capsys.readouterr().out)["active"]
    assert (fault["kind"], fault["servo"]) == ("break", 2)
    assert main(["heal", "break", *robot]) == OK
    assert capsys.readouterr().out == "healed break at servo 2 on bus arm\n"


@pytest.mark.process
def test_without_a_rendezvous_it_is_reached_all_the_same(robot_config, tmp_path, capsys):
    # Where the virtual robot listens is free; nobody listens at the rendezvous.
    zenoh = ZenohConfig(endpoint=f"tcp/127.0.0.1:{free_port() - 10_000}")
    config = msgspec.structs.replace(robot_config, zenoh=zenoh)
    with running(config, tmp_path) as robot:
        assert main(["inject", "break", "--servo", "2", *robot]) == OK
        assert main(["list", *robot]) == OK
    assert capsys.readouterr().out.endswith("1 fault active\n  break at servo 2 on bus arm\n")
    with pytest.raises(
        ConnectionError, match=r"no virtual robot at .*: start it with `wackel up --virtual` or"
    ):
        main(["list", *robot])


@pytest.mark.parametrize(
    ("endpoint", "own"),
    [
        ("tcp/127.0.0.1:7447", "tcp/127.0.0.1:17447"),
        ("tcp/[::]:7447", "tcp/127.0.0.1:17447"),
        ("tcp/0.0.0.0:60000", None),
        ("unixsock-stream//run/robot.sock", None),
        ("quic/10.0.0.1:7447", None),
    ],
)
def test_it_listens_at_a_port_that_follows_from_the_rendezvous(endpoint, own):
    assert own_endpoint(RobotConfig(zenoh=ZenohConfig(endpoint=endpoint))) == own


@pytest.mark.process
def test_where_no_virtual_robot_runs_it_says_what_to_start(rendezvous, tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text(dump(rendezvous.config))
    expected = "simulation of robot testbot answers: start it with `wackel up --virtual` or `wackel"
    with pytest.raises(ConnectionError, match=expected) as error:
        main(["list", "--config", str(file)])
    assert error.value.exit_code == NOT_REACHED


@pytest.mark.process
def test_a_robot_on_wheels_publishes_its_gyro_and_takes_faults_of_its_drive(
    rendezvous: Rendezvous, tmp_path: Path, capsys
):
    bus = BusConfig(port=str(tmp_path / "bus"), servos=[ServoConfig(id=1), ServoConfig(id=2)])
    config = msgspec.structs.replace(
        rendezvous.config,
        buses={"main": bus},
        drive=differential_drive(),
        gyros={"body": GyroConfig()},
    )
    (tmp_path / "robot.toml").write_text(dump(config))
    scenario = tmp_path / "broken.toml"
    scenario.write_text('robot = "robot.toml"\n[[faults]]\nkind = "gyro_offset"\nvalue = 0.5\n')
    samples: list[ImuSample] = []
    reach = ["--config", str(tmp_path / "robot.toml")]
    with (
        Link(config) as link,
        command("--scenario", str(scenario), "--physics", "fast") as process,
    ):
        link.subscribe(keys.IMU, lambda _, sample: samples.append(sample), name="body")
        wait_until(lambda: len(samples) > 100, meanwhile=lambda: link.pump(0.02))
        assert samples[-1].angular_velocity[2] == pytest.approx(0.5, abs=0.05)
        stamps = [sample.stamp for sample in samples]
        # The time of each is that of the physics, however late this computer comes to telling it.
        assert {b - a for a, b in pairwise(stamps)} == {round(1e9 / GyroConfig().rate)}
        assert abs(link.clock.now_ns() - stamps[-1]) < 1_000_000_000
        assert main(["list", *reach]) == OK
        assert capsys.readouterr().out == "1 fault active\n  gyro_offset, value 0.5\n"
        assert main(["inject", "wheel_blocked", "--wheel", "left", "--for", "60", *reach]) == OK
        assert capsys.readouterr().out == "injected wheel_blocked at wheel left, for 60 s\n"
        assert main(["inject", "wheel_blocked", "--wheel", "front", *reach]) == FAILED
        assert "there are left, right" in capsys.readouterr().out
        assert main(["heal", "--wheel", "left", *reach]) == OK
        assert "healed wheel_blocked at wheel left" in capsys.readouterr().out
        process.send_signal(signal.SIGTERM)
        assert process.wait(5) == OK
