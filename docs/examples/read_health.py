"""Prints a robot's health, and each fault with its remedy, without any code of wackel's.

pip install eclipse-zenoh msgpack
python read_health.py [ENDPOINT]
"""

import sys

import msgpack
import zenoh

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{endpoint}"]')
with zenoh.open(config) as session:
    subscriber = session.declare_subscriber("wackel/*/health")
    for sample in subscriber:
        health = msgpack.unpackb(sample.payload.to_bytes())
        print(health["level"], health["summary"], flush=True)
        for fault in health.get("faults", []):
            if fault["status"] == "confirmed":
                print(" ", fault["code"], fault["component"], f"{fault['confidence']:.0%}")
                print("    →", fault["remedy"], flush=True)
