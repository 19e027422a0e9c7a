"""``wackel demo`` without a terminal: a story in lines, and nothing left of it."""

import contextlib
import os
import re
import signal
import tempfile
import threading
import time
from itertools import count
from pathlib import Path

import pytest

from tests.conftest import Rendezvous, wait_until
from tests.end_to_end.command import LIMIT_S, read_until, started, wackel
from tests.view.viewer import Viewer
from wackel_cli.demo import LIMIT_S as LONGEST_S
from wackel_cli.demo import PERIOD_S, START_S, Show
from wackel_cli.supervisor import Change
from wackel_node.link import Link
from wackel_node.node import Node
from wackel_schemas.health import Health
from wackel_schemas.keys import VIRTUAL_REQUEST
from wackel_schemas.virtual import VirtualReply, VirtualRequest
from wackel_view.core import ROBOT

pytestmark = pytest.mark.process

NAMED_S = 180.0
"""Two faults are named and healed in half a minute on a computer that does nothing else."""


def test_the_demo_names_its_faults_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    done = wackel("demo", "--plain", "--faults", "2", cwd=tmp_path, limit_s=NAMED_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(
        r"wackel after \d+\.\d\d s: The cable between servo 4 and servo 5", done.stdout
    )
    assert re.search(
        r"wackel after \d+\.\d\d s: The speed that the drive of wheel w1 shows", done.stdout
    )
    assert done.stdout.count("→") == 2
    assert list(tmp_path.iterdir()) == []
    assert not processes_with(tmp_path)


def test_the_demo_can_be_looked_at_in_a_viewer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with started("demo", "--plain", "--view", cwd=tmp_path) as demo:
        told = read_until(demo, "view: ")
        found = re.search(r"view: ws://127.0.0.1:(\d+) with the layout (\S+)", told)
        assert found is not None
        assert "ThreeDee" in Path(found[2]).read_text()
        with _connected(int(found[1])) as viewer:
            viewer.subscribe(ROBOT)
            while (shown := viewer.next()) is None:
                pass
            assert b"wheel w1" in shown.payload
        demo.send_signal(signal.SIGINT)
        assert demo.wait(10) == 0
    assert not processes_with(tmp_path)


def test_services_that_do_not_come_up_end_the_demo(rendezvous: Rendezvous) -> None:
    with Link(rendezvous.config) as link:
        show = Show(link, rendezvous.config, faults=None)
        show.note(Change("classifier", "exited", 1, "signal 9, restarting in 0.2 s"))
        show.step(time.monotonic() + START_S - 1.0)
        assert not show.over
        show.step(time.monotonic() + START_S)
    assert show.over
    assert not show.began
    assert "classifier ended: signal 9, restarting in 0.2 s" in show.story[0]


def test_who_does_not_answer_is_asked_once_more(rendezvous: Rendezvous) -> None:
    with Link(rendezvous.config) as link, Node("virtual", "main", rendezvous.config) as virtual:
        show = Show(link, rendezvous.config, faults=None)
        show.model.on_health(Health(stamp=1, level="warning", summary="no matter"), 0.0)
        now_s = time.monotonic() + START_S
        show.step(now_s)
        assert "the robot does not answer: once more" in show.story[-1]
        asked: list[VirtualRequest] = []

        def answer(request: VirtualRequest) -> VirtualReply:
            asked.append(request)
            return VirtualReply(stamp=0, ok=True, text="")

        virtual.serve(VIRTUAL_REQUEST, answer)
        thread = threading.Thread(target=virtual.run)
        thread.start()
        try:
            steps = count(now_s, PERIOD_S)
            wait_until(
                lambda: "now the encoder of wheel w1 dies" in show.story[-1],
                meanwhile=lambda: show.step(next(steps)),
            )
            show.step(next(steps) + LONGEST_S)
        finally:
            virtual.stop()
            thread.join()
    assert [each.operation for each in asked] == ["inject", "heal"]
    assert (show.shown, show.missed) == (1, 1)


def _connected(port: int) -> Viewer:
    """A viewer that has been told of all topics; the server may still be starting."""
    viewers: list[Viewer] = []

    def connected() -> bool:
        with contextlib.suppress(ConnectionError):
            viewers.append(Viewer(port))
        return bool(viewers)

    wait_until(connected, LIMIT_S)
    while ROBOT not in viewers[0].channels:
        viewers[0].next()
    return viewers[0]


def processes_with(directory: Path) -> list[str]:
    """Command lines in which the directory occurs."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            line = (process / "cmdline").read_bytes()
        except OSError:
            continue  # it has ended
        if os.fsencode(directory) in line:
            found.append(line.decode(errors="replace"))
    return found
