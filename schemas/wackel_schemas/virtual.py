"""Control of the virtual robot (queries on ``virtual/request``)."""

from typing import Literal

from wackel_schemas.message import Message, Record


class Injection(Record, kw_only=True):
    """One fault of the virtual robot, on its wire or in its drive, as in scenario files.

    Attributes:
        kind: ``break``, ``loose_contact``, ``loose_contact_bursts``, ``silent``,
            ``rhythmic_jammer``, ``permanent_jammer``, ``noise``, ``loss``, ``slow``,
            ``return_delay``, ``undervoltage``, ``contact_resistance``, ``overload``,
            ``hardware_error``, ``frozen``, ``unplugged``, ``latency_timer``, ``power_off``; of the
            drive ``wheel_blocked``, ``wheel_temporarily_blocked``, ``wheel_free``,
            ``wheel_loose``, ``drive_scale``, ``steering_blocked``, ``steering_reference_error``,
            ``steering_offset``, ``drive_sensor_stuck``, ``drive_sensor_scale``,
            ``steering_sensor_stuck``, ``steering_sensor_offset``, ``gyro_offset``,
            ``gyro_frozen``, ``push``, ``ice_patch``; ``wackel virtual kinds`` explains them.
        bus: Which bus; may be empty if there is only one. Always empty for the drive.
        servo: Id of the servo concerned; for a cable, the servo that it leads to (from the
            adapter outwards).
        wheel: Name of the wheel concerned, for the drive.
        value: Strength, by kind: mean contacts lost per s, bit error rate, share of answers lost,
            extra response time in s, Return Delay Time register, V, Ω, bits of Hardware Error
            Status, latency in ms; rad, rad/s, shares.
        start_s: When it begins, s after the scenario starts (live: after the request).
        duration_s: How long it lasts; absent: until healed.
    """

    kind: str
    bus: str = ""
    servo: int | None = None
    wheel: str | None = None
    value: float | None = None
    start_s: float = 0.0
    duration_s: float | None = None


class VirtualRequest(Record, kw_only=True):
    """What to do with the virtual robot: inject a fault, heal matching ones, or list them."""

    operation: Literal["inject", "heal", "list"]
    injection: Injection | None = None


class VirtualReply(Message, kw_only=True):
    """Answer of the virtual robot, with the faults that are active now."""

    ok: bool
    text: str
    active: list[Injection] = []
