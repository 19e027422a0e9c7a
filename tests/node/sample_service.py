"""A real service process for the tests of its life: ``python -m tests.node.sample_service``.

Arguments: a robot.toml, the instance, and what to do: ``run``; ``crash`` or ``hang`` on the first
command message; ``crash-early`` before it is ready; or ``give-up`` then, for a reason it explains.
"""

import sys
import time
from pathlib import Path

from wackel_node import log
from wackel_node.config import ConfigError, load
from wackel_node.node import Node
from wackel_schemas import keys
from wackel_schemas.bus import BusCommand
from wackel_schemas.health import Health, HealthReply, HealthRequest
from wackel_schemas.wire import Rejected


def main(path: str, instance: str, deed: str) -> None:
    log.set_up(f"sample/{instance}")
    with Node("sample", instance, load(Path(path))) as node:
        health = node.publisher(keys.HEALTH)

        def on_command(key: str, message: BusCommand) -> None:
            if deed == "crash":
                raise ValueError(f"cannot do {key}")
            if deed == "hang":
                time.sleep(60)
            if message.seq == 99:
                raise Rejected("seq 99 is not liked here")

        def on_request(request: HealthRequest) -> HealthReply:
            if request.code == "nonsense":
                raise Rejected("code nonsense is not known")
            return HealthReply(stamp=node.clock.now_ns(), ok=True, text=request.code)

        node.subscribe(keys.COMMAND, on_command)
        node.serve(keys.HEALTH_REQUEST, on_request)
        if deed == "crash-early":
            raise RuntimeError("no such thing")
        if deed == "give-up":
            raise ConfigError("robot.toml: no such wheel")
        health.put(Health(stamp=node.clock.now_ns(), level="ok", summary=instance))
        node.ready()
        node.run()


if __name__ == "__main__":
    main(*sys.argv[1:])
