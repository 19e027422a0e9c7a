"""What the sections of the configuration are made of."""

from typing import Annotated

import msgspec
from msgspec import Meta

Name = Annotated[
    str,
    Meta(
        pattern=r"^[a-z0-9][a-z0-9_-]*\Z",
        extra={"words": "a name of a-z, 0-9, - and _ that starts with a letter or digit"},
    ),
]
PortPath = Annotated[
    str,
    Meta(pattern=r"^[^\0]+\Z", extra={"words": "the path of a serial port such as '/dev/ttyUSB0'"}),
]
MaybePath = Annotated[
    str, Meta(pattern=r"^[^\0]*\Z", extra={"words": "a path, or '' for none; no path has a NUL"})
]
ServoId = Annotated[int, Meta(ge=0, le=252)]
Positive = Annotated[float, Meta(gt=0)]
Share = Annotated[float, Meta(ge=0, le=1)]


class Section(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """A table of the file."""
