"""``wackel health`` against a running robot, and what it prints."""

import json
from pathlib import Path

import pytest
from rich.console import Console

from tests import robot
from wackel_cli import servo, top
from wackel_cli.health import as_text, folded, main
from wackel_node.session import NotReached
from wackel_schemas.fault import Evidence
from wackel_schemas.health import FaultRecord, Health, ServiceHealth


def record(**settings: object) -> FaultRecord:
    return FaultRecord(
        **{  # type: ignore[arg-type]
            "code": "cable_break",
            "component": "bus/main/cable/1-2",
            "source": "classifier",
            "severity": "fault",
            "status": "confirmed",
            "message": "The cable is disconnected.",
            "remedy": "Push both plugs home.",
            "confidence": 1.0,
            "first": 1,
            "last": 2,
            **settings,
        }
    )


def test_every_fault_stands_there_with_place_and_remedy_and_services_only_if_not_ready() -> None:
    health = Health(
        stamp=1,
        level="fault",
        summary="Two things.",
        faults=[
            record(
                confidence=0.6,
                suspects=["bus/main/servo/2", "bus/main/supply"],
                evidence=Evidence(summary="the last 2 servos are missing"),
            ),
            record(status="healed", occurrences=3, acknowledged=True),
        ],
        services=[
            ServiceHealth(name="gateway/main", status="ready", since=1),
            ServiceHealth(name="odometry/main", status="crashed", since=1, reason="ValueError"),
        ],
    )
    assert as_text(health).plain.splitlines() == [
        "Two things.",
        "confirmed The cable is disconnected.",
        "          cable_break bus/main/cable/1-2, 60% sure",
        "          It may also be servo 2 on bus main; the supply of bus main.",
        "          Evidence: the last 2 servos are missing.",
        "          → Push both plugs home.",
        "healed    The cable is disconnected.",
        "          cable_break bus/main/cable/1-2, acknowledged, 3 times",
        "crashed   odometry/main: ValueError",
    ]


def test_on_a_narrow_terminal_what_is_folded_goes_on_below_itself() -> None:
    health = Health(stamp=1, level="fault", summary="The cable is loose.", faults=[record()])
    assert folded(as_text(health), Console(width=30)).plain.splitlines() == [
        "The cable is loose.",
        "confirmed The cable is",
        "          disconnected.",
        "          cable_break",
        "          bus/main/cable/1-2",
        "          → Push both plugs",
        "          home.",
    ]


def test_no_terminal_is_too_narrow() -> None:
    health = Health(stamp=1, level="fault", summary="The cable is loose.", faults=[record()])
    narrow = folded(as_text(health), Console(width=5)).plain
    assert "disconnected" in "".join(narrow.split())


def test_text_from_the_network_cannot_steer_the_terminal() -> None:
    said = "a\x1b[2J\x1b]0;b\nc"
    evidence = Evidence(summary=said)
    fault = record(code=said, component=said, message=said, remedy=said, evidence=evidence)
    service = ServiceHealth(name=said, status="dead", since=1, reason=said)
    health = Health(stamp=1, level="fault", summary=said, faults=[fault], services=[service])
    text = as_text(health).plain
    assert "\x1b" not in text
    assert len(text.splitlines()) == 6


@pytest.mark.process
def test_who_has_the_wrong_configuration_is_told_who_is_there(tmp_path: Path) -> None:
    with robot.running(robot.chain(tmp_path, 3), tmp_path) as running:
        running.wait(running.ready)
        other = tmp_path / "other.toml"
        other.write_text((tmp_path / "robot.toml").read_text().replace("testbot", "otherbot"))
        for command, arguments, who in (
            (main, [], "aggregator"),
            (servo.main, ["ping", "1"], "gateway of bus main"),
            (top.main, ["--once"], "aggregator"),
        ):
            told = f"no {who} of robot otherbot answers: here runs testbot; name its robot.toml"
            with pytest.raises(NotReached, match=told):
                command([*arguments, "--config", str(other)])


@pytest.mark.process
def test_a_fault_is_shown_acknowledged_and_once_healed_cleared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with robot.running(robot.chain(tmp_path, 3), tmp_path) as running:
        config = ["--config", str(tmp_path / "robot.toml")]
        running.wait(running.ready)
        assert main(config) == 0
        running.inject("break", 3)
        cable = "bus/main/cable/2-3"
        running.wait(lambda: running.confirmed("cable_break", cable))
        assert main(config) == 1
        assert "Push both plugs" in capsys.readouterr().out
        assert main(["ack", "cable_break", cable, *config]) == 0
        assert main(["clear", "cable_break", cable, *config]) == 1
        assert "1 still active" in capsys.readouterr().err
        running.heal()
        running.wait(running.ready)
        assert main(["clear", *config]) == 0
        capsys.readouterr()
        assert main(["--json", *config]) == 0
        faults = json.loads(capsys.readouterr().out)["health"].get("faults", [])
        assert "cable_break" not in {fault["code"] for fault in faults}
        assert main(["ack", "cable_break", cable, *config]) == 1
        assert "in memory" in capsys.readouterr().err


def test_a_fault_without_its_place_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["ack", "overload"], ["show", "overload", "bus/main/servo/1"], ["forget"]):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 2
    assert "Its component is missing" in capsys.readouterr().err
