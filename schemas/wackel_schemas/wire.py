"""Messages to bytes and back: MessagePack maps with names."""

from typing import Generic, TypeVar, cast

import msgspec

from wackel_schemas.message import Record

MEDIA_TYPE = "application/vnd.msgpack"

T = TypeVar("T", bound=Record)

_encoder = msgspec.msgpack.Encoder()
_decoders: dict[type, msgspec.msgpack.Decoder[Record]] = {}


class Rejected(ValueError):
    """Bytes that are no message of the type that their key promises; the text says why."""


def encoding(message: type[Record]) -> str:
    """Zenoh encoding string of a message type: ``application/vnd.msgpack;Transaction``."""
    return f"{MEDIA_TYPE};{message.__name__}"


def encode(message: Record) -> bytes:
    """Bytes of a message."""
    return _encoder.encode(message)


class EncodedOnce(Generic[T]):
    """Stands in for the records of a list that is encoded often and rarely changes.

    Bytes are remembered for as long as the same objects come again; they must not be changed.
    """

    def __init__(self) -> None:
        self._known: dict[int, tuple[T, T]] = {}  # the record keeps its id from being used again

    def __call__(self, records: list[T]) -> list[T]:
        """The list to encode in place of ``records``: their bytes, of which nothing can be read."""
        known = self._known
        self._known = {
            id(record): known.get(id(record)) or (record, cast(T, msgspec.Raw(encode(record))))
            for record in records
        }
        return [self._known[id(record)][1] for record in records]


def decode(data: bytes, message: type[T]) -> T:
    """The message in ``data``.

    Raises:
        Rejected: Not MessagePack, or not this type.
    """
    decoder = _decoders.get(message)
    if decoder is None:
        decoder = _decoders[message] = msgspec.msgpack.Decoder(message)
    try:
        return decoder.decode(data)  # type: ignore[return-value]
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Rejected(f"no {message.__name__}: {error}") from error
