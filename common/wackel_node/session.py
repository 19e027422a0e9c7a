"""Opens a process's Zenoh session, with what is set otherwise than Zenoh does by itself."""

import json
import os
from typing import Any, Literal, TypeAlias

import zenoh

from wackel_node.config import RobotConfig
from wackel_node.errors import NOT_REACHED, Explained
from wackel_schemas.keys import MOST_HEALTH_BYTES

# One thread of Zenoh's receives, where by itself one waits for the socket and two take turns at
# reading it: a message woke all three. Sending keeps its own, so neither waits for the other. So
# does what routers compute: Python waits for its end, while the one that receives waits for Python.
os.environ.setdefault("ZENOH_RUNTIME", "(rx: (handover: acc))")

# What Zenoh itself puts together before anyone can refuse it (twice as much, as measured).
_MOST_REASSEMBLED = MOST_HEALTH_BYTES

Role: TypeAlias = Literal["peer", "client", "router"]


class NotReached(Explained, ConnectionError):
    """No robot answers where the configuration points; the text says where and what to start."""

    exit_code = NOT_REACHED


def session(config: RobotConfig, role: Role, also_at: str | None = None) -> zenoh.Session:
    """Opens a Zenoh session with explicit endpoints and without multicast.

    Args:
        config: For endpoint and lease.
        role: ``router`` is the rendezvous itself; a ``peer`` (service) links directly to the
            others, comes up without a rendezvous and keeps looking for it; a ``client`` (tool)
            talks through the rendezvous and fails without one.
        also_at: An endpoint at which a peer listens besides, unless that is taken.

    Raises:
        NotReached: The rendezvous is absent (client), or its address is taken (router).
    """
    endpoint = config.zenoh.endpoint
    # A service on the robot listens on loopback only: what is outside comes in by the rendezvous.
    listen = {"router": [endpoint], "peer": ["tcp/127.0.0.1:0"], "client": []}[role]
    settings: dict[str, Any] = {
        "mode": role,
        "listen/endpoints": listen if also_at is None else [*listen, also_at],
        "connect/endpoints": [] if role == "router" else [endpoint],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        # Nothing is scouted, so waiting for it at the start (500 ms) is lost time.
        "scouting/delay": 1,
        "open/return_conditions/connect_scouted": False,
        "timestamping/enabled": True,  # the cache of a latched topic orders its values by it
        "transport/link/tx/lease": config.zenoh.lease_ms,
        # Of 64 KiB each, filled only as needed. With the two of the default, what follows a long
        # message is lost where the sending thread does not get its turn within a millisecond.
        "transport/link/tx/queue/size/data": 16,
        "transport/link/rx/max_message_size": _MOST_REASSEMBLED,
    }
    if also_at is not None:
        settings["listen/exit_on_failure"] = False
    if role == "peer":
        settings["connect/timeout_ms"] = -1
        settings["connect/exit_on_failure"] = False
        settings["connect/retry"] = {
            "period_init_ms": 50,
            "period_max_ms": 500,
            "period_increase_factor": 2,
        }
    zenoh_config = zenoh.Config()
    for key, value in settings.items():
        zenoh_config.insert_json5(key, json.dumps(value))
    # The session complains of data that arrives while it closes, which is no error.
    zenoh.init_log_from_env_or("error,zenoh::api::session=off")
    try:
        return zenoh.open(zenoh_config)
    except zenoh.ZError as error:
        if role == "router":
            raise NotReached(
                f"cannot listen at {endpoint}: is another wackel up or zenohd running?"
            ) from error
        raise NotReached(f"no robot at {endpoint}: start it with `wackel up`") from error
