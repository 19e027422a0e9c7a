"""Paths that name what can fail, the same in every message: ``bus/main/cable/3-7``.

A cable is named after the servos it joins, in cable order from the adapter.
"""

ADAPTER = "adapter"
ODOMETRY = "odometry"
DRIVE = "drive"
COMMAND = "command"


def bus(name: str) -> str:
    """The bus as a whole, where nothing narrower is known."""
    return f"bus/{name}"


def adapter(bus_name: str) -> str:
    """The USB or UART adapter of a bus."""
    return f"bus/{bus_name}/{ADAPTER}"


def supply(bus_name: str) -> str:
    """The power supply of a bus."""
    return f"bus/{bus_name}/supply"


def servo(bus_name: str, servo_id: int) -> str:
    """One servo."""
    return f"bus/{bus_name}/servo/{servo_id}"


def cable(bus_name: str, before: int | None, after: int) -> str:
    """The cable between two neighbours in the chain; ``before=None`` is the adapter's own."""
    return f"bus/{bus_name}/cable/{ADAPTER if before is None else before}-{after}"


def wheel_drive(name: str) -> str:
    """What rolls a wheel: motor, encoder and what lies between them and the floor."""
    return f"wheel/{name}/drive"


def wheel_steering(name: str) -> str:
    """What steers a wheel, with its sensor."""
    return f"wheel/{name}/steering"


def gyro(name: str) -> str:
    """A gyro."""
    return f"gyro/{name}"


def service(name: str) -> str:
    """A process of wackel: ``<service>/<instance>``."""
    return f"service/{name}"


def in_words(component: str) -> str:
    """A component path as people say it: ``the cable between servo 3 and servo 7 on bus main``."""
    match component.split("/"):
        case ["bus", bus]:
            return f"bus {bus}"
        case ["bus", bus, "adapter"]:
            return f"the adapter of bus {bus}"
        case ["bus", bus, "supply"]:
            return f"the supply of bus {bus}"
        case ["bus", bus, "servo", servo]:
            return f"servo {servo} on bus {bus}"
        case ["bus", bus, "cable", ends]:
            before, _, after = ends.partition("-")
            start = "the adapter" if before == "adapter" else f"servo {before}"
            return f"the cable between {start} and servo {after} on bus {bus}"
        case ["wheel", wheel, part]:
            return f"the {part} of wheel {wheel}"
        case ["gyro", gyro]:
            return f"the gyro {gyro}"
        case ["drive"]:
            return "the drive as a whole"
        case ["command"]:
            return "the commanded velocity"
        case ["service", *name]:
            return f"the service {'/'.join(name)}"
        case _:
            return component
