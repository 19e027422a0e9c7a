"""A rendezvous with one reader of everything a bus publishes: what a gateway has to feed."""

import sys
from pathlib import Path

from wackel_node.config import load
from wackel_node.link import Link
from wackel_node.session import session
from wackel_schemas import keys


def main(argv: list[str]) -> int:
    """Reads until killed; says ``ready`` on stdout once it listens."""
    config = load(Path(argv[0]))
    with session(config, "router"), Link(config) as link:
        link.subscribe_raw(keys.TRANSACTION, lambda *_: None)
        link.subscribe_raw(keys.STATE, lambda *_: None)
        print("ready", flush=True)
        while True:
            link.pump(1.0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
