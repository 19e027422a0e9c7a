"""The header that every message carries."""

import msgspec


class Record(msgspec.Struct, omit_defaults=True, kw_only=True, gc=False):
    """A part of a message: a map with names; a field that is absent has its default.

    None refers back to what it is part of, so Python need not search them for garbage in cycles.
    """


class Message(Record, kw_only=True):
    """The header of every message.

    Attributes:
        stamp: When what the message tells was acquired, UTC, ns since 1970. Never the time of
            sending.
        boot: Random number of the publishing process, new at every start.
        seq: Gapless count of the messages of one publisher on one key, from 0; a jump is a loss.
    """

    stamp: int
    boot: int = 0
    seq: int = 0
