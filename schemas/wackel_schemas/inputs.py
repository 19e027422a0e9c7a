"""What a service has taken in, so that a recording can be diagnosed anew from exactly that."""

from wackel_schemas.message import Message, Record


class InputStream(Record, kw_only=True):
    """Messages of one publisher, one after the other without a gap.

    Attributes:
        key: Below the robot's name.
        boot: Of the publisher.
        seq: Of the first of them.
    """

    key: str
    boot: int
    seq: int


class Inputs(Message, kw_only=True):
    """What a service took in since its last word, in that order (``inputs/<service>/<instance>``).

    Topics reach each process in an order of their own, a service starts later than a recorder, and
    one that is busy drops messages: its conclusions follow from what is told here.

    Attributes:
        streams: Where the messages come from; a gap in the numbers begins a stream of its own.
        order: For each message the index of its stream.
    """

    streams: list[InputStream]
    order: list[int]
