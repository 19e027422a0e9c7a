"""Wires the transactions of all buses to their classifiers, and their reports to ``fault``."""

import msgspec

from wackel_classifier.core import BusClassifier
from wackel_node.config import RobotConfig
from wackel_node.log import logger
from wackel_node.node import Node
from wackel_schemas import keys, wire
from wackel_schemas.bus import Transaction

REPEAT_S = 1.0
"""Active faults are told again so often, for those who came later."""


def run(config: RobotConfig) -> None:
    """Classifies until the process is told to stop."""
    with Node("classifier", "main", config) as node:
        faults = node.publisher(keys.FAULT, source="classifier")
        classifiers = {
            bus: BusClassifier(bus, bus_config, config.classifier)
            for bus, bus_config in config.buses.items()
        }

        def take(key: str, transaction: Transaction) -> None:
            bus = keys.chunk_of(keys.TRANSACTION, key, "bus")
            classifier = classifiers.get(bus)
            if classifier is None:
                raise wire.Rejected("this bus is not in the configuration")
            for report in classifier.step(transaction):
                faults.put(report)
                logger.info("%s: %s", report.status, report.message)

        def repeat() -> None:
            for classifier in classifiers.values():
                for report in classifier.active():
                    faults.put(msgspec.structs.replace(report, repeated=True))

        node.subscribe(keys.TRANSACTION, take)
        node.every(REPEAT_S, repeat)
        node.ready()
        node.run()
