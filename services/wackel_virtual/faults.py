"""The kinds of faults that can be injected, and what all active ones together do to a bus.

Conditions of a bus are a pure function of the active faults, so that any number of them combine
and healing one leaves the others as they are.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import msgspec

from wackel_node.errors import USAGE, Explained
from wackel_schemas.virtual import Injection

Place = Literal["bus", "servo", "cable", "bus or servo", "robot", "drive", "steering", "any wheel"]
"""What a fault concerns. The last four are of the drive: the whole robot; a wheel that is driven; a
wheel that is steered; a wheel or the whole robot."""

OVERLOAD = 1 << 5
"""Bit of Hardware Error Status (e-manual, X series, "Hardware Error Status(70)")."""
OVERHEATING = 1 << 2


class InjectionError(Explained, ValueError):
    """A fault that cannot be injected; the text is one line that says what is allowed."""

    exit_code = USAGE


@dataclass(frozen=True)
class Kind:
    """One kind of fault.

    Attributes:
        text: What happens on the wire.
        place: What ``servo`` or ``wheel`` of an injection names.
        value: What ``value`` means, with unit; empty if it has none.
        default: Its value where none is given.
        least, most: Its allowed range.
        whole: Whether it must be a whole number.
    """

    text: str
    place: Place
    value: str = ""
    default: float | None = None
    least: float = 0.0
    most: float = 0.0
    whole: bool = False


_LOSSES = "mean contacts lost per s"

KINDS: dict[str, Kind] = {
    "break": Kind(
        "The cable to the servo is disconnected: nothing behind it is heard, and what gets its "
        "supply through it loses power.",
        "cable",
    ),
    "loose_contact": Kind(
        "The cable to the servo loses contact for some milliseconds at random times; each change "
        "may throw stray bytes on the bus.",
        "cable",
        _LOSSES,
        5.0,
        0.01,
        200.0,
    ),
    "loose_contact_bursts": Kind(
        "As loose_contact, but the losses are longer and come while the cable is moved: a second "
        "every few seconds. Servos may restart.",
        "cable",
        _LOSSES,
        5.0,
        0.01,
        15.0,
    ),
    "duplicate_id": Kind(
        "A second servo with the id of this one is beside it: both answer at once, and their bits "
        "collide.",
        "servo",
    ),
    "silent": Kind("The servo hears and obeys, but never answers.", "servo"),
    "rhythmic_jammer": Kind(
        "A zero byte stands before the first and after every packet. A servo that is named as "
        "the jammer does not answer. Two jammers silence the bus.",
        "bus or servo",
    ),
    "permanent_jammer": Kind(
        "Stray bytes fill every pause of the bus and destroy packets, the more the longer the "
        "host has been silent. A servo that is named as the jammer does not answer. Masked by a "
        "rhythmic jammer.",
        "bus or servo",
    ),
    "noise": Kind(
        "Bits are inverted at random, in both directions.",
        "bus",
        "bit error rate",
        1e-5,
        0.0,
        0.5,
    ),
    "loss": Kind(
        "Answers are lost or damaged on their way to the host.",
        "bus or servo",
        "share of the packets",
        0.05,
        0.0,
        1.0,
    ),
    "slow": Kind(
        "The servo takes longer to answer.",
        "servo",
        "extra response time in s",
        0.002,
        0.0,
        1.0,
    ),
    "return_delay": Kind(
        "The Return Delay Time register of the servo has a wrong value. Writing it cures it.",
        "servo",
        "register value, 2 µs units",
        254,
        0,
        254,
        whole=True,
    ),
    "undervoltage": Kind(
        "The servo reports this input voltage, or without a servo the supply gives it; below its "
        "limit it raises an alert, which lasts until it is rebooted.",
        "bus or servo",
        "V",
        9.0,
        0.0,
        30.0,
    ),
    "contact_resistance": Kind(
        "The power contact of the cable to the servo has corroded: the servos supplied through it "
        "see a voltage that drops with their current.",
        "cable",
        "Ω",
        5.0,
        0.0,
        1000.0,
    ),
    "overload": Kind(
        "The servo reports overload: alert, torque off until it is rebooted; comes back while "
        "the load lasts.",
        "servo",
    ),
    "hardware_error": Kind(
        "The servo reports hardware errors (overheating unless told otherwise): alert until it is "
        "rebooted; comes back while the cause lasts.",
        "servo",
        "bits of Hardware Error Status",
        OVERHEATING,
        1,
        63,
        whole=True,
    ),
    "frozen": Kind(
        "The servo goes on answering with the measured values of this moment.",
        "servo",
    ),
    "unplugged": Kind("The USB adapter is unplugged: the port is gone until healed.", "bus"),
    "latency_timer": Kind(
        "The USB latency timer of the adapter delays answers.", "bus", "ms", 16, 0, 255, whole=True
    ),
    "power_off": Kind("The supply of the servos is switched off.", "bus"),
}


def checked(injection: Injection, ids: Sequence[int]) -> Injection:
    """The injection with its default value filled in.

    Args:
        injection: What is asked for.
        ids: Servos of the bus in cable order.

    Raises:
        InjectionError: Unknown kind, place or value that it cannot have.
    """
    kind = KINDS.get(injection.kind)
    if kind is None:
        raise InjectionError(f"kind {injection.kind!r} is unknown; there are {', '.join(KINDS)}")
    name, servo = injection.kind, injection.servo
    if injection.wheel is not None:
        raise InjectionError(f"{name} concerns the bus; leave out the wheel")
    if kind.place == "bus" and servo is not None:
        raise InjectionError(f"{name} concerns the whole bus; leave out the servo")
    if kind.place in ("servo", "cable") and servo is None:
        which = "the servo" if kind.place == "servo" else "the servo to which the cable leads"
        raise InjectionError(f"{name} needs {which}; there are {_listed(ids)}")
    if servo is not None and servo not in ids:
        raise InjectionError(f"servo {servo} is not on this bus; there are {_listed(ids)}")
    return of_strength(injection, kind)


def of_strength(injection: Injection, kind: Kind) -> Injection:
    """The injection with its default value filled in; value and times checked.

    Raises:
        InjectionError: A value or a time that it cannot have.
    """
    name, value = injection.kind, injection.value
    if value is None:
        value = kind.default
    elif not kind.value:
        raise InjectionError(f"{name} takes no value")
    elif not kind.least <= value <= kind.most or (kind.whole and value != int(value)):
        raise InjectionError(
            f"value {value:g} of {name} ({kind.value}) must be "
            f"{'a whole number ' if kind.whole else ''}from {kind.least:g} to {kind.most:g}"
        )
    if not 0 <= injection.start_s < math.inf:
        raise InjectionError(f"it cannot begin {injection.start_s:g} s from now")
    if injection.duration_s is not None and not 0 < injection.duration_s < math.inf:
        raise InjectionError(f"it cannot last {injection.duration_s:g} s")
    return msgspec.structs.replace(injection, value=value)


def matches(injection: Injection, kind: str, servo: int | None) -> bool:
    """Whether a heal request means this injection; an empty kind and no servo mean all."""
    return kind in ("", injection.kind) and servo in (None, injection.servo)


@dataclass
class Conditions:
    """How a bus is, given its active faults; servos and cables by position in the chain.

    Attributes:
        open_cables: Cables that do not connect.
        powered: Whether the supply is on.
        supply_volts: What it gives, if not its nominal voltage.
        servo_volts: Voltages that servos see regardless of the chain.
        extra_ohm: Contact resistances of cables.
        doubled: Servos beside which there is another one with their id.
        silent: Servos that do not answer.
        rhythmic, permanent: Jammers; a position, or None for one that is no servo.
        bit_error_rate: Of the whole bus.
        loss: Shares of lost answers; key None for all servos.
        extra_delay_ns: By servo.
        return_delay: Register values by servo.
        hardware_errors: Bits by servo.
        frozen: Servos with stuck values.
        plugged: Whether the adapter is there.
        latency_ms: USB latency timer.
    """

    open_cables: set[int] = field(default_factory=set)
    powered: bool = True
    supply_volts: float | None = None
    servo_volts: dict[int, float] = field(default_factory=dict)
    extra_ohm: dict[int, float] = field(default_factory=dict)
    doubled: set[int] = field(default_factory=set)
    silent: set[int] = field(default_factory=set)
    rhythmic: list[int | None] = field(default_factory=list)
    permanent: list[int | None] = field(default_factory=list)
    bit_error_rate: float = 0.0
    loss: dict[int | None, float] = field(default_factory=dict)
    extra_delay_ns: dict[int, int] = field(default_factory=dict)
    return_delay: dict[int, int] = field(default_factory=dict)
    hardware_errors: dict[int, int] = field(default_factory=dict)
    frozen: set[int] = field(default_factory=set)
    plugged: bool = True
    latency_ms: int | None = None


def conditions(active: Iterable[tuple[Injection, bool]], ids: Sequence[int]) -> Conditions:
    """What the active faults do together.

    Args:
        active: Checked injections; beside each, whether its contact is open now (loose contacts).
        ids: Servos in cable order.
    """
    result = Conditions()
    for injection, contact_open in active:
        value = injection.value or 0.0
        place = None if injection.servo is None else ids.index(injection.servo)
        if place is None:
            _concern_bus(result, injection.kind, value)
        else:
            _concern_place(result, injection.kind, place, value, contact_open=contact_open)
    return result


def _concern_bus(result: Conditions, kind: str, value: float) -> None:
    match kind:
        case "rhythmic_jammer":
            result.rhythmic.append(None)
        case "permanent_jammer":
            result.permanent.append(None)
        case "noise":
            result.bit_error_rate = min(0.5, result.bit_error_rate + value)
        case "loss":
            result.loss[None] = max(value, result.loss.get(None, 0.0))
        case "undervoltage":
            result.supply_volts = value
        case "unplugged":
            result.plugged = False
        case "latency_timer":
            result.latency_ms = int(value)
        case "power_off":
            result.powered = False


def _concern_place(
    result: Conditions, kind: str, place: int, value: float, *, contact_open: bool
) -> None:
    match kind:
        case "break":
            result.open_cables.add(place)
        case "loose_contact" | "loose_contact_bursts":
            if contact_open:
                result.open_cables.add(place)
        case "duplicate_id":
            result.doubled.add(place)
        case "silent":
            result.silent.add(place)
        case "rhythmic_jammer":
            result.rhythmic.append(place)
        case "permanent_jammer":
            result.permanent.append(place)
        case "loss":
            result.loss[place] = max(value, result.loss.get(place, 0.0))
        case "slow":
            delay_ns = round(value * 1e9)
            result.extra_delay_ns[place] = result.extra_delay_ns.get(place, 0) + delay_ns
        case "return_delay":
            result.return_delay[place] = int(value)
        case "undervoltage":
            result.servo_volts[place] = value
        case "contact_resistance":
            result.extra_ohm[place] = result.extra_ohm.get(place, 0.0) + value
        case "overload":
            result.hardware_errors[place] = result.hardware_errors.get(place, 0) | OVERLOAD
        case "hardware_error":
            result.hardware_errors[place] = result.hardware_errors.get(place, 0) | int(value)
        case "frozen":
            result.frozen.add(place)


def _listed(ids: Sequence[int]) -> str:
    return ", ".join(map(str, ids)) or "none"
