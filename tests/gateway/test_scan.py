"""``wackel scan``: what it finds, what it writes, what it says when there is nothing."""

import json
import tomllib
from pathlib import Path

import pytest
from rich.console import Console

from tests.gateway.conftest import IDS, Bus, StartGateway
from wackel_gateway.port import Port
from wackel_gateway.scan import BadUsage, NoPort, _table, main, robot_toml
from wackel_gateway.survey import ALL_IDS, Found, Survey
from wackel_node.config import load, parse


def found(servo_id: int, baud_rate: int = 1_000_000, model: str | None = "XM430-W210") -> Found:
    return Found(id=servo_id, baud_rate=baud_rate, model_number=1030, model=model, firmware=50)


def test_the_robot_toml_loads_and_says_what_it_does_not_know() -> None:
    servos = [found(1), found(2), found(9, baud_rate=57_600), found(4, model=None)]
    text = robot_toml("/dev/ttyUSB0", servos)
    config = parse(text)
    assert config.buses["main"].ids() == (1, 2, 4)
    assert config.buses["main"].baud_rate == 1_000_000
    assert "CABLE ORDER IS UNKNOWN" in text
    assert "Servo 9 answers at 57600 bit/s" in text
    assert "Servo 4 has the unknown model number" in text
    assert tomllib.loads(text)["buses"]["main"]["port"] == "/dev/ttyUSB0"


def test_an_existing_file_is_not_written_over(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("mine")
    with pytest.raises(BadUsage, match="exists"):
        main(["--port", "/dev/null", "--write", str(path)])
    assert path.read_text() == "mine"


def test_a_port_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(NoPort, match="there is no such port"):
        main(["--port", str(tmp_path / "none")])


def test_a_file_that_is_no_port_is_told_as_such(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path):
        with pytest.raises(NoPort, match="it is no serial port"):
            main(["--port", str(path)])


@pytest.mark.process
def test_a_survey_one_by_one_stops_between_two_pings_when_it_is_interrupted(bus: Bus) -> None:
    advanced: list[float] = []
    with Port(bus.config.port, bus.config.baud_rate) as port:
        survey = Survey(port, lambda: len(advanced) >= 3, advanced.append)
        assert survey.run([bus.config.baud_rate], ALL_IDS) == []
    assert len(advanced) == 3


def test_the_table_fits_a_terminal_of_80_columns() -> None:
    console = Console(width=80)
    with console.capture() as capture:
        console.print(_table([found(252, baud_rate=4_000_000, model="XM540-W270-R")]))
    assert "XM540-W270-R" in capture.get()
    assert "4000000" in capture.get()
    assert "…" not in capture.get()


@pytest.mark.process
def test_a_scan_lists_all_servos_and_writes_a_file_that_works(
    bus: Bus, tmp_path: Path, capsys: pytest.CaptureFixture[str], start_gateway: StartGateway
) -> None:
    path = tmp_path / "written.toml"
    rates = ["--baud", "1000000", "57600"]
    assert main(["--port", bus.config.port, *rates, "--write", str(path)]) == 0
    assert "XM430-W210" in capsys.readouterr().out
    written = load(path).buses["main"]
    assert written.ids() == IDS
    gateway = start_gateway(written)
    gateway.wait_until(gateway.answering(IDS))


@pytest.mark.process
def test_ids_are_pinged_one_by_one_on_demand(bus: Bus, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--port", bus.config.port, "--baud", "1000000", "--json"]
    assert main([*arguments, "--ids", "2-4,99"]) == 0
    servos = json.loads(capsys.readouterr().out)
    assert [servo["id"] for servo in servos] == [2, 3, 4]
    assert servos[0]["return_delay_us"] == 0
    assert servos[0]["voltage"] > 10
    assert main([*arguments, "--thorough"]) == 0
    assert [servo["id"] for servo in json.loads(capsys.readouterr().out)] == list(IDS)


@pytest.mark.process
def test_nobody_there_is_said_and_told_by_the_exit_code(
    bus: Bus, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--port", bus.config.port, "--baud", "1000000", "--ids", "99"]) == 1
    assert "no servo answers" in capsys.readouterr().err
