"""What deploys wackel names only what exists, and is in shape for those who read it."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import zenoh

from wackel_aggregator.services import LATE_PERIODS
from wackel_cli.commands import COMMANDS
from wackel_node.config import RobotConfig
from wackel_node.node import HEARTBEAT_S

ROOT = Path(__file__).parents[2]
COMPOSE = ROOT / "compose"
UNITS = sorted((COMPOSE / "systemd").glob("*.service"))
CONTAINERS = sorted((COMPOSE / "containers").glob("*.yaml"))
WACKEL = "/opt/wackel/bin/wackel"


def settings(unit: Path) -> dict[str, str]:
    """All settings of a unit; of one that is given twice, the last."""
    lines = unit.read_text().splitlines()
    return dict(line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
@pytest.mark.process
def test_systemd_finds_nothing_wrong(tmp_path: Path) -> None:
    units = tmp_path / "units"
    shutil.copytree(COMPOSE / "systemd", units)
    for unit in units.glob("*.service"):
        text = unit.read_text().replace(WACKEL, sys.executable)
        unit.write_text(text.replace("/usr/bin/zenohd", sys.executable))
    done = subprocess.run(
        ["systemd-analyze", "verify", *map(str, sorted(units.glob("wackel*.*[et]")))],
        env={**os.environ, "SYSTEMD_UNIT_PATH": f"{units}:"},
        capture_output=True,
        text=True,
        check=False,
    )
    # It also tells of units of the computer itself, which are none of ours.
    assert [line for line in done.stderr.splitlines() if "wackel" in line] == []
    assert done.returncode == 0


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_unit_runs_a_command_that_exists_and_is_watched(unit: Path) -> None:
    found = settings(unit)
    program, *arguments = found["ExecStart"].split()
    if program != WACKEL:
        assert unit.name == "wackel-rendezvous.service"
        return
    assert arguments[0] in COMMANDS
    assert found["Type"] == "notify"
    # Later than health, which says so first.
    assert float(found["WatchdogSec"]) > LATE_PERIODS * HEARTBEAT_S


def test_all_units_restart_unprivileged_and_with_the_target() -> None:
    found = settings(COMPOSE / "systemd" / "wackel-.service.d" / "common.conf")
    assert found["PartOf"] == "wackel.target"
    assert found["Restart"] == "on-failure"
    assert found["User"] == "wackel"
    assert found["ProtectSystem"] == "strict"
    target = (COMPOSE / "systemd" / "wackel.target").read_text()
    for unit in UNITS:
        assert unit.name in target or "WantedBy=wackel.target" in unit.read_text()


def test_udev_rules_are_lists_of_matches_and_assignments() -> None:
    text = (COMPOSE / "udev" / "99-wackel.rules").read_text()
    term = r'[A-Z]+(\{[A-Za-z_/]+\})?(==|=|\+=|!=)"[^"]*"'
    rules = [line.lstrip("#") for line in text.splitlines() if "==" in line and "# " not in line]
    assert len(rules) == 4
    for rule in rules:
        assert re.fullmatch(rf"{term}(, {term})*", rule), rule
    assert 'ATTR{latency_timer}="1"' in text


def test_zenohd_listens_where_services_look_for_it() -> None:
    config = zenoh.Config.from_file(str(COMPOSE / "zenoh" / "zenohd.json5"))
    default = RobotConfig().zenoh
    assert json.loads(config.get_json("mode")) == "router"
    assert json.loads(config.get_json("listen/endpoints")) == [default.endpoint]
    assert json.loads(config.get_json("scouting/multicast/enabled")) is False
    assert json.loads(config.get_json("transport/link/tx/lease")) == default.lease_ms


@pytest.mark.parametrize("path", CONTAINERS, ids=lambda path: path.name)
def test_containers_run_commands_that_exist_on_files_that_exist(path: Path) -> None:
    text = path.read_text()
    assert "\t" not in text
    blocks = re.split(
        r"^  (?=\w)", text.split("\nservices:\n")[1].split("\nvolumes:")[0], flags=re.M
    )
    services = {block.split(":", 1)[0]: block for block in blocks if block.strip()}
    assert {"rendezvous", "classifier", "aggregator"} < services.keys()
    shared = text.split("\nservices:\n")[0]
    for name, block in services.items():
        command = json.loads(re.findall(r"command: (\[.*\])", block)[0])
        assert name == "rendezvous" or command[0] in COMMANDS
        hardened = shared if "<<: *service" in block else block
        for setting in ("read_only: true", "cap_drop: [ALL]", "no-new-privileges:true"):
            assert setting in hardened
    for mounted in re.findall(r"- (\.\./[^:$]+):", text):
        assert (path.parent / mounted).exists()


def test_the_image_is_built_from_the_lock_and_runs_as_nobody_special() -> None:
    text = (COMPOSE / "containers" / "Containerfile").read_text()
    assert "--require-hashes --requirement requirements.lock" in text
    assert "--no-deps --no-build-isolation ." in text
    assert text.index("USER wackel") < text.index("ENTRYPOINT")
    for copied in re.findall(r"^COPY (?!--)(.+) \S+$", text, flags=re.M):
        assert all((ROOT / name).exists() for name in copied.split())
    python = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    assert set(re.findall(r"python:([0-9.]+)", text)) == {python.removeprefix(">=")}
