"""Wires the transactions of all buses to their classifiers, and their reports to ``fault``."""

from itertools import chain

from wackel_classifier.core import BusClassifier
from wackel_node.config import RobotConfig
from wackel_node.fault_publisher import FaultPublisher
from wackel_node.node import Node
from wackel_node.precedence import DIAGNOSIS, LOOK_S, GiveWay, come_first
from wackel_schemas import keys, wire
from wackel_schemas.bus import Transaction


def run(config: RobotConfig) -> None:
    """Classifies until the process is told to stop."""
    come_first(DIAGNOSIS)
    with Node("classifier", "main", config) as node:
        node.keep_journal()
        classifiers = {
            bus: BusClassifier(bus, bus_config, config.classifier)
            for bus, bus_config in config.buses.items()
        }
        every = classifiers.values()
        faults = FaultPublisher(
            node, "classifier", lambda: chain.from_iterable(each.active() for each in every)
        )

        def take(key: str, transaction: Transaction) -> None:
            bus = keys.chunk_of(keys.TRANSACTION, key, "bus")
            classifier = classifiers.get(bus)
            if classifier is None:
                raise wire.Rejected("this bus is not in the configuration")
            for report in classifier.step(transaction):
                faults.put(report)

        node.subscribe(keys.TRANSACTION, take)
        node.every(LOOK_S, GiveWay())
        node.ready()
        node.run()
