"""A virtual robot: servos on real pseudo-terminals, with faults that can be injected.

``servo``, ``table``, ``indirect``, ``sensors``, ``motion``: one servo. ``chain``: cables, supply.
``adapter``: the USB adapter. ``framing``, ``groups``: how instructions are understood. ``wire``:
all of them as discrete events. ``board``: a device that is no servo. ``disturbance``, ``faults``,
``bus``: what can go wrong.
``scenario``: files that say what goes wrong when. ``port``, ``service``: the process.

What the servos move: ``drivetrain`` (motors and sensors), ``body``, ``fast_body``,
``mujoco_body`` (the floor), ``gyro``, ``calibration_errors``; ``drive_faults``, ``drive_course``
(what can go wrong); ``coupled_drive`` (on the bus), ``drive_simulation`` (without one).

The bus is pure: time is an argument, so an hour of traffic takes seconds in a test::

    bus = VirtualBus(config, seed=1)
    bus.inject(Injection(kind="break", servo=5))
    chunks = bus.exchange(at_ns, instruction, wait_ns)
"""

from wackel_virtual.bus import VirtualBus
from wackel_virtual.faults import InjectionError

__all__ = ["InjectionError", "VirtualBus"]
