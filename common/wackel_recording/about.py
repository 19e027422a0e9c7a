"""What a recording says of itself, in a metadata record at the head of each of its files."""

from dataclasses import dataclass
from typing import Self

PROFILE = "wackel"
METADATA_NAME = "wackel"


@dataclass(frozen=True)
class About:
    """Whose recording it is.

    Attributes:
        robot: The robot's name, as in its keys.
        config: The configuration that the recorder ran with, as a ``robot.toml`` that spells out
            every default, so that a later wackel reads the same from it.
        version: Of the wackel that recorded.
        started_ns: When recording started, UTC ns; the same in all files of one recording.
        session: Random name of the recording; the same in all its files.
        part: Which of its files this is, from 0.
    """

    robot: str
    config: str
    version: str
    started_ns: int
    session: str
    part: int = 0

    def to_metadata(self) -> dict[str, str]:
        """As the text fields of an MCAP metadata record."""
        return {name: str(value) for name, value in vars(self).items()}

    @classmethod
    def from_metadata(cls, fields: dict[str, str]) -> Self:
        """Reads :meth:`to_metadata` back.

        Raises:
            ValueError: A field is missing or is no number where one is due.
        """
        try:
            return cls(
                robot=fields["robot"],
                config=fields["config"],
                version=fields["version"],
                started_ns=int(fields["started_ns"]),
                session=fields["session"],
                part=int(fields["part"]),
            )
        except KeyError as error:
            raise ValueError(f"its metadata lacks {error.args[0]}") from error
