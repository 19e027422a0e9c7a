"""The services whose conclusions a replay draws anew: their cores, fed by key as on the robot."""

from abc import ABC, abstractmethod
from collections.abc import Iterable

from wackel_classifier.core import BusClassifier
from wackel_node.config import RobotConfig
from wackel_schemas import wire
from wackel_schemas.bus import Transaction
from wackel_schemas.keys import TRANSACTION, Topic, chunk_of
from wackel_schemas.message import Message

CLASSIFIER, ODOMETRY, DIAGNOSER = "classifier", "odometry", "diagnoser"


class Replayed(ABC):
    """The core of one service.

    Attributes:
        topics: What it takes in.
    """

    topics: tuple[Topic[Message], ...]

    @abstractmethod
    def take(self, key: str, message: Message) -> Iterable[Message]:
        """What it concludes from a message on one of its topics.

        Raises:
            wire.Rejected: The message cannot be used.
        """


class ReplayedClassifier(Replayed):
    """``wackel classifier``."""

    topics = (TRANSACTION,)  # type: ignore[assignment]

    def __init__(self, config: RobotConfig) -> None:
        self._classifiers = {
            name: BusClassifier(name, bus, config.classifier) for name, bus in config.buses.items()
        }

    def take(self, key: str, message: Message) -> Iterable[Message]:
        """What it concludes; a bus that is not configured has no classifier."""
        assert isinstance(message, Transaction)
        classifier = self._classifiers.get(chunk_of(TRANSACTION, key, "bus"))
        if classifier is None:
            raise wire.Rejected("the configuration has no such bus")
        return classifier.step(message)
