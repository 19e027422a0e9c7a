"""Byte stuffing of Dynamixel Protocol 2.0 (e-manual, Protocol 2.0, "Packet Process").

The run FF FF FD may stand at the start of a packet only. Where instruction, error and parameters
contain it, an extra FD follows it on the wire. The run cannot overlap itself, so one replacement
from left to right is exact in both directions, for FF FF FF FD and for any number of runs.
"""

_RUN = b"\xff\xff\xfd"
_STUFFED = b"\xff\xff\xfd\xfd"


def stuff(body: bytes) -> bytes:
    """Instruction through parameters as they go over the wire."""
    return body.replace(_RUN, _STUFFED)


def unstuff(body: bytes) -> bytes:
    """Instruction through parameters as they were meant; the inverse of :func:`stuff`.

    A run without its extra FD is illegal, yet the vendor's Python library sends such packets, and
    length and CRC alone frame them; it is kept as it stands.
    """
    return body.replace(_STUFFED, _RUN)
