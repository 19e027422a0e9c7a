"""``wackel view``: the robot in a viewer of the Foxglove protocol."""

import argparse
import sys
from pathlib import Path

from wackel_node.arguments import add_config, config_of
from wackel_node.errors import OK, NotWritable

PORT = 8765  # where viewers look for it

_DESCRIPTION = """\
Serves the running robot to viewers that speak the Foxglove WebSocket protocol,
such as Foxglove and Lichtblick: pose and path, wheels in the colour of their
verdict, the velocities that the wheels stand for, faults as a log, health in
words.

Open the viewer, choose "Open connection", "Foxglove WebSocket", and enter the
address that is printed; import the layout (docs/view-layout.json, or --layout).
"""

_EPILOG = """\
examples:
  wackel view                       for a viewer on this computer
  wackel view --host 0.0.0.0        for viewers on the network, who see all
  wackel view --layout layout.json  writes the layout, and ends

Ctrl-C ends it.
"""


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel view",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_config(parser)
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen at (default: %(default)s)"
    )
    parser.add_argument(
        "--port", type=_port, default=PORT, help="default: %(default)s; 0: any that is free"
    )
    parser.add_argument("--layout", metavar="FILE", type=Path, help="write the layout, and end")
    arguments = parser.parse_args(argv)
    if arguments.layout is not None:
        write_layout(arguments.layout)
        return OK
    config = config_of(arguments)

    from wackel_view.service import run

    run(config, arguments.host, arguments.port, lambda address: print(address, flush=True))
    return OK


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is no port: 0 … 65535")
    return int(text)


def write_layout(path: Path) -> None:
    """Writes the prepared layout, for a viewer to import.

    Raises:
        NotWritable: It cannot be written there.
    """
    from wackel_view.layout import layout

    try:
        path.write_text(layout() + "\n", encoding="utf-8")
    except OSError as error:
        raise NotWritable(f"{path}: {error.strerror}") from error


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
