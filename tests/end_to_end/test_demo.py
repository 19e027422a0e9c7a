"""``wackel demo`` without a terminal: a story in lines, and nothing left of it."""

import os
import re
import tempfile
from pathlib import Path

import pytest

from tests.end_to_end.command import wackel

pytestmark = pytest.mark.process


def test_the_demo_names_its_faults_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    done = wackel("demo", "--plain", "--faults", "2", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(
        r"wackel after \d+\.\d\d s: The cable between servo 4 and servo 5", done.stdout
    )
    assert re.search(r"wackel after \d+\.\d\d s: Servo 3 on bus main does not answer", done.stdout)
    assert done.stdout.count("→") == 2
    assert list(tmp_path.iterdir()) == []
    assert not processes_with(tmp_path)


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
