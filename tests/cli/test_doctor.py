"""``wackel doctor`` finds what is wrong on computers made to order."""

import json
from pathlib import Path

import pytest

from tests.conftest import Rendezvous
from tests.imu.tree import Tree
from wackel_cli.doctor import Finding, examine, main
from wackel_node.config import BusConfig, RobotConfig, ZenohConfig, dump
from wackel_node.config_drive import GyroConfig

NOWHERE = ZenohConfig(endpoint="tcp/127.0.0.1:9")  # discard: nothing listens there


def computer(
    root: Path, latency: str = "1\n", processes: tuple[str, ...] = ("init",), governor: str = ""
) -> Path:
    """A root directory with what the kernel of such a computer would show."""
    files = {"sys/class/tty/ttyUSB7/device/latency_timer": latency}
    files |= {f"proc/{pid}/comm": f"{name}\n" for pid, name in enumerate(processes, 1)}
    if governor:
        files["sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"] = governor
    for name, content in files.items():
        path = root / name
        path.parent.mkdir(parents=True)
        path.write_text(content)
    return root


def found(config: RobotConfig, root: Path) -> dict[str, Finding]:
    return {finding.check: finding for finding in examine(config, root)}


@pytest.fixture
def config(tmp_path: Path) -> RobotConfig:
    port = tmp_path / "ttyUSB7"
    port.write_text("")
    return RobotConfig(zenoh=NOWHERE, buses={"main": BusConfig(port=str(port))})


def test_a_computer_in_order_only_has_to_be_started(
    config: RobotConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wackel_cli.doctor.may_come_first", lambda: True)
    findings = found(config, computer(tmp_path / "root", governor="performance"))
    assert [f.check for f in findings.values() if f.result != "good"] == ["rendezvous"]
    assert "wackel up" in findings["rendezvous"].remedy


def test_what_costs_time_is_a_warning_with_its_remedy(
    config: RobotConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wackel_cli.doctor.may_come_first", lambda: False)
    root = computer(tmp_path / "root", "16\n", ("init", "ModemManager"), "powersave")
    findings = found(config, root)
    costly = ("latency timer of bus main", "ModemManager", "CPU governor", "real-time priority")
    for check in costly:
        assert findings[check].result == "warning"
        assert findings[check].remedy


def test_a_port_that_is_not_there_is_bad(tmp_path: Path) -> None:
    config = RobotConfig(zenoh=NOWHERE, buses={"main": BusConfig(port=str(tmp_path / "none"))})
    finding = found(config, tmp_path)["port of bus main"]
    assert (finding.result, "does not exist" in finding.seen) == ("bad", True)


def test_a_port_that_may_not_be_opened_names_the_group(
    config: RobotConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)  # root may open all
    monkeypatch.setattr(Path, "group", lambda _: "dialout")
    port = Path(config.buses["main"].port)
    port.chmod(0o660)
    finding = found(config, tmp_path)["port of bus main"]
    assert finding.result == "bad"
    assert finding.remedy.startswith("`sudo usermod -aG dialout ")
    port.chmod(0o600)  # a group that has no access is no use to anybody
    assert "chmod 660" in found(config, tmp_path)["port of bus main"].remedy


def test_an_adapter_without_latency_timer_is_not_asked(config: RobotConfig, tmp_path: Path) -> None:
    assert "latency timer of bus main" not in found(config, tmp_path)


def test_a_gyro_of_the_computer_is_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gyro = GyroConfig(source="iio", device="lsm6dsl_gyro")
    config = RobotConfig(zenoh=NOWHERE, gyros={"body": gyro, "head": GyroConfig()})
    none = found(config, tmp_path)["gyro body"]
    assert (none.result, "there are none" in none.seen) == ("bad", True)
    tree = Tree(tmp_path)
    assert found(config, tmp_path)["gyro body"].result == "good"
    assert "gyro head" not in found(config, tmp_path)
    monkeypatch.setattr("os.access", lambda *_: False)  # root may do all
    forbidden = found(config, tmp_path)["gyro body"]
    assert (forbidden.result, "99-wackel.rules" in forbidden.remedy) == ("bad", True)
    (tree.directory / "buffer/enable").unlink()
    assert "no buffer" in found(config, tmp_path)["gyro body"].seen


def test_no_bus_at_all_is_a_warning(tmp_path: Path) -> None:
    assert found(RobotConfig(zenoh=NOWHERE), tmp_path)["buses"].result == "warning"


@pytest.mark.process
def test_a_rendezvous_that_listens_is_good(rendezvous: Rendezvous, tmp_path: Path) -> None:
    assert found(rendezvous.config, tmp_path)["rendezvous"].result == "good"


def test_the_exit_code_says_whether_the_robot_can_work(
    config: RobotConfig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(dump(config))
    assert main([str(path)]) == 0
    assert "→ start the robot with `wackel up robot.toml`" in capsys.readouterr().out
    Path(config.buses["main"].port).unlink()
    assert main([str(path), "--json"]) == 1
    findings = json.loads(capsys.readouterr().out)
    assert {"bad"} == {f["result"] for f in findings if f["check"] == "port of bus main"}


def test_the_robot_toml_where_one_is_needs_not_be_named(
    config: RobotConfig,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "robot.toml").write_text(dump(config))
    monkeypatch.chdir(tmp_path)
    assert main([]) == 0
    assert "port of bus main" in capsys.readouterr().out
