"""Logging of a process: one line an event, to stderr, in journald's and a terminal's terms."""

import logging
import os
import sys

logger = logging.getLogger("wackel")

_PRIORITY = {"DEBUG": 7, "INFO": 6, "WARNING": 4, "ERROR": 3, "CRITICAL": 2}  # sd-daemon(3)


def set_up(name: str, verbose: bool = False) -> None:
    """Sends the log to stderr.

    Under systemd the journal keeps the time and takes the level from a ``<N>`` prefix
    (sd-daemon(3)); elsewhere time and level are written out.

    Args:
        name: Of the process, at the head of each line.
        verbose: Also what is only worth knowing while looking for something.
    """
    handler = logging.StreamHandler(sys.stderr)
    if "JOURNAL_STREAM" in os.environ:
        handler.setFormatter(_Journal(f"{name}: %(message)s"))
    else:
        handler.setFormatter(
            logging.Formatter(f"%(asctime)s {name} %(levelname)s: %(message)s", "%H:%M:%S")
        )
    logger.handlers[:] = [handler]
    logger.setLevel(logging.DEBUG if verbose else logging.INFO)


class _Journal(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        priority = _PRIORITY.get(record.levelname, 6)
        lines = super().format(record).splitlines()
        return "\n".join(f"<{priority}>{line}" for line in lines)
