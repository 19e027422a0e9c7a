"""``wackel paper``: the paper's experiment through gateway, bus, wheels and diagnoser; a minute."""

import tempfile
from pathlib import Path

import pytest

from tests.end_to_end.command import wackel
from tests.end_to_end.test_demo import processes_with

pytestmark = pytest.mark.process

LIMIT_S = 300.0


def test_it_shows_the_papers_signature_and_names_the_blocked_wheel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("matplotlib")
    inside = tmp_path / "inside"
    inside.mkdir()
    monkeypatch.setenv("TMPDIR", str(inside))
    monkeypatch.setattr(tempfile, "tempdir", None)
    done = wackel("paper", "--output", "out", cwd=tmp_path, limit_s=LIMIT_S)
    assert done.returncode == 0, done.stdout + done.stderr
    for name in ("figure5.png", "figure6.png"):
        assert (tmp_path / "out" / name).read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "out" / "signatures.txt").read_text()
    free, blocked = text.split("Wheel 3 blocked at")
    assert "signature 000101" in free
    assert "Step III  wheel/w3/drive: " in blocked
    assert "Step IV  wheel/w3/drive: The robot does not move as commanded" in blocked
    assert "wheel 3 -0.00" in blocked or "wheel 3 0.00" in blocked
    assert list(inside.iterdir()) == []
    assert not processes_with(inside)
