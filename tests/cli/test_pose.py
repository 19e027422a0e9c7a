"""What ``wackel pose`` prints, and what it takes; against a live service: tests/odometry."""

import math
from pathlib import Path

import pytest

from wackel_cli.pose import as_lines, main
from wackel_node.config import RobotConfig, dump
from wackel_node.session import NotReached
from wackel_schemas.drive import Exclusion, InputState, Odometry


def odometry(**settings: object) -> Odometry:
    return Odometry(
        **{  # type: ignore[arg-type]
            "stamp": 1,
            "x": 1.25,
            "y": -0.5,
            "theta": math.pi / 2,
            "vx": 0.3,
            "vy": 0.0,
            "omega": -0.1,
            "pose_covariance": [9e-4, 0, 0, 0, 16e-4, 0, 0, 0, 1e-4],
            "twist_covariance": [0.0] * 9,
            "valid": True,
            **settings,
        }
    )


def test_pose_how_well_it_is_known_and_motion() -> None:
    assert list(as_lines(odometry())) == [
        "at +1.250 m -0.500 m, heading +1.5708 rad (+90.0°)",
        "known within 0.050 m and 0.57°, one sigma",
        "goes +0.300 m/s ahead and +0.000 m/s to the left, turns by -0.1000 rad (-5.7°) a second",
    ]
    assert list(as_lines(odometry(standing=True)))[2:] == ["stands"]


def test_what_is_not_believed_is_told() -> None:
    lost = odometry(
        valid=False,
        reason="too few inputs",
        inputs=[
            InputState(name="wheel/a/roll", result="used"),
            InputState(name="gyro/body", result="rejected"),
        ],
        excluded=[Exclusion(component="wheel/b/drive", fault="actuator", reason="it is blocked")],
    )
    said = list(as_lines(lost))
    assert said[1] == "not known: too few inputs"
    assert said[2:] == ["rejected: gyro/body", "wheel/b/drive is excluded: it is blocked"]


@pytest.mark.parametrize("covariance", [[], [1.0], [-1.0] * 9, [math.nan] * 9, [math.inf] * 9])
def test_any_covariance_can_come(covariance: list[float]) -> None:
    assert list(as_lines(odometry(pose_covariance=covariance)))


@pytest.mark.parametrize(
    "arguments", [["-1e-05", "2", "-3"], ["--heading-sigma", "0.1", "-1e-5", "2", "-3."]]
)
def test_numbers_may_be_small_and_stand_after_options(
    robot_config: RobotConfig, tmp_path: Path, arguments: list[str]
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(dump(robot_config))
    with pytest.raises(NotReached):  # it has understood them
        main(["set", *arguments, "--config", str(path)])


@pytest.mark.parametrize(
    "arguments", [["set"], ["set", "1", "2"], ["reset", "1"], ["show", "1"], ["move"], ["set", "a"]]
)
def test_wrong_usage_is_refused(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
