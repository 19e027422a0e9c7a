"""Messages to bytes and back: MessagePack maps with names."""

from typing import TypeVar

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
