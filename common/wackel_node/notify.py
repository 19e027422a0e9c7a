"""Telling systemd how a service is (sd_notify(3)): ready, still turning, stopping."""

import os
import socket


def notify(state: str) -> None:
    """Sends a state such as ``READY=1``; does nothing where no one supervises the process."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):  # the abstract name space
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as channel:
        try:
            channel.sendto(state.encode(), address)
        except OSError:  # a supervisor that is gone must not take the service with it
            return
