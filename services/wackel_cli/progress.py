"""How far the reading of a recording is, for a person at a terminal."""

import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack

from rich.console import Console
from rich.progress import Progress

from wackel_recording.reader import Entry, Recording

_PATIENCE_S = 2.0
_LOOK_EVERY = 1000  # entries between two looks at the clock: well below a tenth of a second


def with_progress(entries: Iterable[Entry], recording: Recording) -> Iterator[Entry]:
    """The same entries; on a terminal, after a while, with a bar."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield from entries
        return
    patient_until_s = time.monotonic() + _PATIENCE_S
    with ExitStack() as stack:
        progress = Progress(console=console, transient=True, auto_refresh=False)
        task = progress.add_task("", total=1.0)
        for number, entry in enumerate(entries, 1):
            yield entry
            if number % _LOOK_EVERY or time.monotonic() < patient_until_s:
                continue
            if not progress.live.is_started:
                stack.enter_context(progress)
            progress.update(task, completed=recording.progress, refresh=True)
