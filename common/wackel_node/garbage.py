"""Python's search for garbage in cycles, which messages do not leave.

Nor do records that are made in every step of a core: they are structs without ``gc``, which spares
them the search, and are made in a third of the time that named tuples take.
"""

import gc

_OBJECTS = 10_000
"""New objects from one search to the next, instead of 700: some twenty messages of twenty servos, a
search of which costs microseconds. Together they took a twentieth of a service's time."""


def collect_rarely() -> None:
    """Call when everything that stays exists: searches leave that out from now on."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(_OBJECTS)
