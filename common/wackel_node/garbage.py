"""Python's search for garbage in cycles, which messages do not leave."""

import gc

_OBJECTS = 10_000
"""New objects from one search to the next, instead of 700: some twenty messages of twenty servos, a
search of which costs microseconds. Together they took a twentieth of a service's time."""


def collect_rarely() -> None:
    """Call when everything that stays exists: searches leave that out from now on."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(_OBJECTS)
