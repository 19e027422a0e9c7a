"""``wackel``: one program, one subcommand for each thing to do."""

import errno
import importlib
import os
import sys
from collections.abc import Sequence

from wackel_cli.commands import COMMANDS, GROUPS
from wackel_node.errors import FAILED, OK, USAGE, Explained

INTERRUPTED = 130  # 128 + SIGINT, as a shell has it
BROKEN_PIPE = 141  # 128 + SIGPIPE


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one subcommand; returns the exit code that :func:`overview` explains."""
    _open_what_is_closed()
    try:
        code = _dispatch(list(sys.argv[1:] if argv is None else argv))
        sys.stdout.flush()
    except BrokenPipeError:
        # `wackel echo | head`: the exit would flush into the closed pipe once more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    return code


def _open_what_is_closed() -> None:
    """With `>&-` Python has no stream, and prints to stdout what is for a stderr that is closed."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8"))


def _dispatch(arguments: list[str]) -> int:
    match arguments:
        case [] | ["-h" | "--help" | "help"]:
            print(overview())
            return OK if arguments else USAGE
        case ["--version"]:
            from importlib.metadata import version

            print(f"wackel {version('wackel')}")
            return OK
        case ["help", name, *_]:
            return _run(name, ["--help"])
        case [name, *rest]:
            return _run(name, rest)
    raise AssertionError(arguments)


def overview() -> str:
    """What ``wackel --help`` prints."""
    lines = [
        "usage: wackel COMMAND [ARGUMENT ...]",
        "",
        "Finds the faulty wire, servo or wheel of a robot; says so in one health topic.",
    ]
    for title, commands in GROUPS.items():
        lines += ["", f"{title}:"]
        lines += [f"  {name:<12}{command.help}" for name, command in commands.items()]
    lines += [
        "",
        "`wackel COMMAND --help` explains a command. Begin with `wackel demo`, or with",
        "`wackel scan --write robot.toml` and `wackel up robot.toml`.",
        "",
        "Exit codes: 0 done, or stopped on request; 1 failed, or a check found something;",
        "2 wrong usage or configuration; 3 no robot reached; 130 interrupted.",
    ]
    return "\n".join(lines)


def _run(name: str, arguments: list[str]) -> int:
    command = COMMANDS.get(name)
    if command is None:
        print(f"wackel: {_unknown(name)}", file=sys.stderr)
        return USAGE
    try:
        code: int = importlib.import_module(command.module).main(arguments)
        sys.stdout.flush()
    except Explained as error:
        from wackel_cli.lines import printable  # slow to import

        print(printable(f"wackel {name}: {error}"), file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as error:
        if error.errno != errno.ENOSPC or error.filename is not None:
            raise
        # `wackel echo > FILE` on a full disk; as above, nothing may be flushed once more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"wackel {name}: the output cannot be written: {error.strerror}", file=sys.stderr)
        return FAILED
    return code


def _unknown(name: str) -> str:
    import difflib

    near = difflib.get_close_matches(name, COMMANDS, n=1)
    hint = f"did you mean {near[0]}?" if near else "wackel --help lists them"
    return f"no command {name!r}; {hint}"


if __name__ == "__main__":
    sys.exit(main())
