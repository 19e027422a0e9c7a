"""One program: its overview, its subcommands, its exit codes."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from wackel_cli.__main__ import main, overview
from wackel_cli.commands import COMMANDS


def test_the_overview_names_every_command_and_exit_code() -> None:
    text = overview()
    for name, command in COMMANDS.items():
        assert f"  {name} " in text
        assert command.help in text
    for code in ("0 done", "1 failed", "2 wrong usage", "3 no robot", "130 interrupted"):
        assert code in text
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize(("argv", "code"), [(["--help"], 0), (["-h"], 0), (["help"], 0), ([], 2)])
def test_the_overview_is_shown_on_request_and_for_want_of_a_command(
    argv: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(argv) == code
    assert capsys.readouterr().out == overview() + "\n"


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("wackel 0.")


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [("aggregatr", "did you mean aggregator?"), ("xyzzy", "wackel --help lists them")],
)
def test_an_unknown_command_gets_a_suggestion(
    wrong: str, hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([wrong]) == 2
    assert capsys.readouterr().err == f"wackel: no command {wrong!r}; {hint}\n"


def test_an_error_is_one_line_that_cannot_steer_the_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["replay", "a\x1b[2J\nb"]) == 1
    assert "\x1b" not in (told := capsys.readouterr().err)
    assert told.count("\n") == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as exit_:
        main([name, "--help"])
    assert exit_.value.code == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: wackel {name}")
    assert len(text.splitlines()) > 5
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize(
    ("name", "default"),
    [
        ("replay", "that in the recording"),
        ("play", "robot.toml where you are, else that in the recording"),
        ("pilot", "robot.toml where you are"),
        ("explain", "robot.toml where you are"),
        ("config", "robot.toml where you are, else all defaults"),
        ("health", "robot.toml where you are, else all defaults"),
    ],
)
def test_help_tells_which_configuration_is_taken(
    name: str, default: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([name, "--help"])
    told = " ".join(capsys.readouterr().out.split())
    assert f"the robot's configuration (default: {default})" in told


@pytest.mark.parametrize("name", ["pilot", "explain", "up"])
def test_what_needs_a_configuration_tells_where_it_looked_for_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([name]) == 2
    assert capsys.readouterr().err.startswith(f"wackel {name}: robot.toml: no such file")


def test_an_expected_failure_is_one_line_with_its_own_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.toml"
    assert main(["config", str(path)]) == 2
    path.write_text("robot = 3")
    assert main(["config", str(path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert lines[1].startswith(f"wackel config: {path}: robot = 3: allowed is")


@pytest.mark.process
@pytest.mark.parametrize("arguments", [["schema", "Health"], ["--help"]])
def test_a_reader_that_leaves_early_ends_the_command_quietly(arguments: list[str]) -> None:
    command = [sys.executable, "-m", "wackel_cli", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 141


@pytest.mark.process
@pytest.mark.parametrize(
    ("arguments", "code"), [("schema Health >&-", 0), ("--help >&-", 0), ("nonsense 2>&-", 2)]
)
def test_what_is_for_a_closed_stream_goes_nowhere(arguments: str, code: int) -> None:
    line = f"exec {shlex.quote(sys.executable)} -m wackel_cli {arguments}"
    done = subprocess.run(["sh", "-c", line], capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (code, b"", b"")


@pytest.mark.process
def test_the_overview_imports_nothing_that_takes_time() -> None:
    code = (
        "import sys; from wackel_cli.__main__ import main; main(['--help']); "
        "sys.exit(str([m for m in ('zenoh', 'numpy', 'rich', 'msgspec') if m in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr == "[]\n"


@pytest.mark.process
def test_output_that_a_full_disk_does_not_take_is_told_in_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "wackel_cli", "schema", "Health"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("wackel schema: the output cannot be written: No space left")
    assert len(done.stderr.splitlines()) == 1
