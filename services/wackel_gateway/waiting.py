"""How long a loop that listens to somebody else's traffic may wait."""

from time import monotonic_ns

_LONGEST_MS = 100  # the node's own messages wait at most so long for their turn


def wait_ms(*dues_ns: int | None) -> int:
    """Until the first of some times (monotonic; ``None``: never), rounded up."""
    now_ns = monotonic_ns()
    left_ms = [-((now_ns - due_ns) // 1_000_000) for due_ns in dues_ns if due_ns is not None]
    return max(0, min([_LONGEST_MS, *left_ms]))
