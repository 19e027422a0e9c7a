"""``wackel paper``: what is made of what was heard; the experiment itself takes a minute."""

import re
from pathlib import Path

import msgspec
import pytest

from tests.conftest import Rendezvous
from wackel_cli.paper import NotRun, _inject, main
from wackel_cli.paper_log import (
    BLOCKED_S,
    END_S,
    EXPECTED,
    PaperLog,
    signatures,
    verdicts,
)
from wackel_cli.paper_text import story
from wackel_cli.wheeled_robot import three_wheels
from wackel_node.config import ServoConfig, dump, parse
from wackel_node.config_drive import DriveConfig
from wackel_node.errors import OK
from wackel_node.link import Link
from wackel_schemas.bus import BusState, ServoState
from wackel_schemas.drive import ImuSample, TwistCommand
from wackel_schemas.fault import Evidence, FaultReport
from wackel_schemas.residuals import Candidate, PaperStep, Residuals
from wackel_schemas.virtual import Injection

NAMES = ("(1,2;1)", "(1,2;2)", "(1,3;1)", "(1,3;3)", "(2,3;2)", "(2,3;3)")
START_NS = 1_700_000_000_000_000_000


def drive() -> DriveConfig:
    config = three_wheels("paper", Path("here"), [ServoConfig(id=i) for i in range(1, 7)], 12.0)
    assert config.drive is not None
    return config.drive


def residuals(at_s: float, signature: str) -> Residuals:
    return Residuals(
        stamp=START_NS + round(at_s * 1e9),
        commanded=[1.5, 0.0, 1.5],
        candidates=[
            Candidate(name=name, vx=1.5 + int(bit), vy=0.0, omega=1.5, deviates=bit == "1")
            for name, bit in zip(NAMES, signature, strict=True)
        ],
        signature=signature,
        steps=[PaperStep(step="III", text="not the others", components=["wheel/w3/drive"])]
        if at_s > BLOCKED_S
        else [],
    )


@pytest.fixture
def heard() -> PaperLog:
    """An experiment at 10 Hz: in the end the sound wheels at 90 %, wheel 3 at rest."""
    log = PaperLog(drive())
    rates = (0.0, 0.0, 0.0)
    for step in range(round(10 * END_S) + 1):
        at_s = step / 10
        stamp = START_NS + round(at_s * 1e9)
        log.on_command(TwistCommand(stamp=stamp, vx=1.5, vy=0.0, omega=1.5))
        after = at_s >= BLOCKED_S
        wanted = log.wanted[-1][1]
        rates = (0.9 * wanted[0], 0.9 * wanted[1], 0.0) if after else tuple(wanted)  # type: ignore[assignment]
        servos = [ServoState(id=2 * i + 1, velocity=rate) for i, rate in enumerate(rates)]
        log.on_state(BusState(stamp=stamp, servos=servos))
        log.on_imu(ImuSample(stamp=stamp, angular_velocity=(0.0, 0.0, 0.1 if after else 1.5)))
        signature = "111111" if after else (EXPECTED if step % 2 else "000000")
        log.on_residuals(residuals(at_s, signature))
    log.on_fault(
        FaultReport(
            stamp=START_NS + round((BLOCKED_S + 0.05) * 1e9),
            code="wheel_blocked",
            component="wheel/w3/drive",
            status="active",
            confidence=1.0,
            message="The drive of wheel w3 is blocked.",
            remedy="",
            evidence=Evidence(summary=""),
            since=0,
        )
    )
    return log


@pytest.mark.parametrize("place", ["file", "file/below", "/proc"])
def test_where_nothing_can_be_written_it_is_said_before_the_experiment(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wackel_cli.paper.find_spec", lambda _: True)
    monkeypatch.setattr("wackel_cli.paper._experiment", lambda _: pytest.fail("it was made"))
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("precious")
    with pytest.raises(NotRun, match=f"{place}: nothing can be written there: "):
        main(["--output", place])
    assert Path("file").read_text() == "precious"


def test_a_virtual_robot_that_does_not_answer_is_told(
    rendezvous: Rendezvous, monkeypatch: pytest.MonkeyPatch
) -> None:
    def late(*_: object) -> None:
        raise TimeoutError

    monkeypatch.setattr(Link, "ask", late)
    with (
        Link(rendezvous.config) as link,
        pytest.raises(NotRun, match="virtual robot does not answer"),
    ):
        _inject(link, Injection(kind="wheel_free"))


def test_signatures_and_verdicts_are_counted_by_phase(heard: PaperLog) -> None:
    free = heard.between((10.0, 30.05))
    assert dict(signatures(free)) == pytest.approx({EXPECTED: 0.5, "000000": 0.5}, abs=0.01)
    assert verdicts(free, "III") == {"names nothing": 1.0}
    assert verdicts(heard.between((40.0, 50.0)), "III") == {"wheel/w3/drive: not the others": 1.0}


def test_rates_are_compared_with_what_was_wanted(heard: PaperLog) -> None:
    assert heard.mean_rates((10.0, 30.0)) == pytest.approx([1.0, 1.0, 1.0])
    assert heard.mean_rates((40.0, 50.0)) == pytest.approx([0.9, 0.9, 0.0])
    assert heard.mean_yaw((10.0, 30.0)) == pytest.approx(1.0)
    assert heard.mean_yaw((40.0, 50.0)) == pytest.approx(0.1 / 1.5)


def test_what_came_before_the_first_command_does_not_count() -> None:
    log = PaperLog(drive())
    log.on_state(BusState(stamp=START_NS, servos=[ServoState(id=1, velocity=1.0)]))
    log.on_residuals(residuals(1.0, EXPECTED))
    assert (log.started, log.times, log.residuals, log.at(0.0), log.swinging()) == (
        False,
        [],
        [],
        None,
        None,
    )


def test_the_text_tells_signatures_verdicts_and_differences(heard: PaperLog) -> None:
    text = story(heard, play=0.25, hertz=2.0)
    assert ", ".join(NAMES) in text
    assert re.search(r"  (49|50|51)\.\d%  signature 000101", text)
    assert "  100.0%  signature 111111" in text
    assert "  100.0%  Step III  wheel/w3/drive: not the others" in text
    assert "  100.0%  Step III  names nothing" in text
    assert "wheel 1 0.90, wheel 2 0.90, wheel 3 0.00" in text
    assert "mean yaw rate by what was wanted: 0.07" in text
    assert "36.05 s  active: The drive of wheel w3 is blocked." in text
    assert "25% of the speed at 2 Hz" in text
    assert "itself was late" not in text


def test_a_computer_that_was_late_is_told(heard: PaperLog) -> None:
    _, blocked = heard.faults[0]
    heard.on_fault(msgspec.structs.replace(blocked, code="host_lag", component="bus/main"))
    text = story(heard, play=0.25, hertz=2.0)
    assert "itself was late" in text
    assert text.count("is blocked.") == 1


def test_the_figure_shows_where_the_free_wheel_swings_most(heard: PaperLog) -> None:
    swinging = heard.swinging()
    assert swinging is not None
    assert swinging.signature == EXPECTED
    best = residuals(20.0, EXPECTED)
    best.candidates[3].vx = 2.9
    heard.on_residuals(best)
    assert heard.swinging() == best


def test_a_phase_without_residuals_says_so() -> None:
    log = PaperLog(drive())
    log.on_command(TwistCommand(stamp=START_NS, vx=0.0, vy=0.0, omega=0.0))
    log.on_residuals(residuals(20.0, EXPECTED))
    assert "the diagnoser has said nothing" in story(log, play=0.25, hertz=2.0)


def test_the_figures_are_pictures(heard: PaperLog, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from wackel_cli.paper_figures import figure_5, figure_6

    for figure in (figure_5, figure_6):
        path = tmp_path / f"{figure.__name__}.png"
        figure(heard, path)
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.stat().st_size > 20_000


def test_its_robot_is_a_valid_configuration(tmp_path: Path) -> None:
    servos = [ServoConfig(id=i) for i in range(1, 13)]
    config = three_wheels("paper", tmp_path, servos, 12.0)
    assert parse(dump(config)) == config


def test_help_says_what_it_needs(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == OK
    assert "wackel[sim]" in capsys.readouterr().out
