"""A robot on a terminal of any size: lines of styled text from a model. No clock, no terminal."""

import math
import textwrap

from rich.text import Text

from wackel_cli.lines import clock_time, printable
from wackel_cli.robot_model import STALE_S, Bus, RobotModel, Servo
from wackel_schemas import component
from wackel_schemas.component import in_words
from wackel_schemas.health import FaultRecord, Health, ServiceHealth

_LEVEL_STYLE = {"ok": "green", "warning": "yellow", "fault": "bold red", "unknown": "magenta"}
_SEVERITY_STYLE = {"info": "cyan", "warning": "yellow", "fault": "bold red"}
_UNKNOWN = "magenta"  # its source is silent: neither a fault for certain nor well
_WORST_FIRST = ("bold red", _UNKNOWN, "yellow", "cyan")  # as health ranks them
_SERVICE_STYLE = {"ready": "green", "starting": "cyan", "stopped": "dim"}
_STALE = "bright_black"
_SILENT_S = 1.0  # without an answer: every servo is asked several times a second
_VALUE_STALE_S = 30.0  # voltage and temperature are read in the background, seconds apart
_CELL = 26  # columns of a servo in the compact form
_MODEL, _LONGEST_MODEL = 10, 14  # columns
_ROLE = 8  # columns at least
_NUMBERS = 43  # columns of a servo's line but for model, role and faults
_FAULT_LINES = 5  # what the servos leave to the faults before they become compact
_SHOWN_STATUSES = ("confirmed", "unknown", "pending")


def render(model: RobotModel, now_s: float, width: int, height: int) -> list[Text]:
    """The view as lines, none wider than ``width``, no more than ``height``.

    Args:
        model: What to show.
        now_s: Monotonic time, as in the model.
        width, height: Of the terminal; at 80 x 24 a chain of 12 servos fits as a table, longer
            ones in a compact form.
    """
    top = [_header(model, now_s), *_drive(model, now_s)]
    services = _services(model.health, width)
    faults = _faults(model, width)
    room = height - len(top) - len(services) - len(model.buses)
    table = sum(len(bus.servos) + 1 for bus in model.buses.values())
    as_table = table + min(len(faults), _FAULT_LINES) <= room
    chains: list[Text] = []
    for bus in model.buses.values():
        chains.append(_bus_line(bus, model, now_s))
        marks = _Marks(bus, model)
        form = _table if as_table else _compact
        chains += form(bus, marks, now_s, width)
    if not model.buses:
        chains = [Text("no bus is heard of yet", style="dim")]
    left = height - len(top) - len(services) - len(chains)
    lines = [*top, *chains, *_cut(faults, left), *services][: max(height, 0)]
    for line in lines:
        line.plain = printable(line.plain)  # codes, names and texts come from the network
        line.truncate(width, overflow="ellipsis")
    return lines


def _cut(lines: list[Text], room: int) -> list[Text]:
    """What fits, and how much does not."""
    if len(lines) <= room:
        return lines
    if room <= 0:
        return []
    return [*lines[: room - 1], Text(f"… {len(lines) - room + 1} more lines", style="dim")]


def _header(model: RobotModel, now_s: float) -> Text:
    line = Text()
    if model.health is None or model.health_s is None:
        line.append(" ? ", "reverse magenta").append(f" {model.robot}", "bold")
        return line.append("  no health yet: does the aggregator run?")
    health, age_s = model.health, now_s - model.health_s
    if age_s > STALE_S:
        line.append(" UNKNOWN ", "reverse magenta").append(f" {model.robot}", "bold")
        return line.append(f"  health is {_duration(age_s)} old; then: {health.summary}", _STALE)
    style = _LEVEL_STYLE[health.level]
    line.append(f" {health.level.upper()} ", f"reverse {style}").append(f" {model.robot}", "bold")
    line.append(f"  {health.summary}")
    lost = [name for name, can in health.capabilities.items() if not can]
    if lost:
        line.append(f"  cannot: {', '.join(lost)}".replace("can_", ""), style)
    return line


def _drive(model: RobotModel, now_s: float) -> list[Text]:
    """Where the robot is and how it moves; each wheel, and what is wrong with the drive."""
    if not model.wheels:
        return []
    line = Text().append("drive", "bold")
    odometry, at_s = model.odometry, model.odometry_s
    if odometry is None or at_s is None:
        line.append("  no pose yet: does the odometry run?", _STALE)
    else:
        degrees = math.degrees(odometry.theta)
        line.append(f"  at {odometry.x:+.2f} {odometry.y:+.2f} m, {degrees:+.0f}°")
        line.append(f"  {math.hypot(odometry.vx, odometry.vy):.2f} m/s")
        line.append(f"  {math.degrees(odometry.omega):+.0f} °/s")
        if now_s - at_s > _SILENT_S:
            line.stylize(_STALE)
            line.append(f"  {_duration(now_s - at_s)} old", "magenta")
        elif not odometry.valid:
            line.append(f"  not valid: {odometry.reason}", "magenta")
    wheels = Text("wheels", style="dim")
    faults = [f for f in model.faults(*_SHOWN_STATUSES) if not f.inhibited_by]
    inputs = odometry.inputs if odometry is not None else []
    unseen = {each.name.rpartition("/")[0] for each in inputs if each.result == "missing"}
    for name in model.wheels:
        of_it = (component.wheel_drive(name), component.wheel_steering(name))
        wrong = [fault for fault in faults if fault.component in of_it]
        sound = _UNKNOWN if f"wheel/{name}" in unseen else "green"
        wheels.append("  ● ", _worst(wrong) if wrong else sound).append(name, "default")
        if sound == _UNKNOWN:
            wheels.append(" no values", _UNKNOWN)
        for fault in wrong:
            part = fault.component.rpartition("/")[2]
            wheels.append(f" {part}: {fault.code}", _style(fault))
    for fault in faults:
        if fault.component.partition("/")[0] in ("gyro", "drive", "command"):
            wheels.append("  ● ", _style(fault))
            wheels.append(f"{fault.component}: {fault.code}", _style(fault))
    return [line, wheels]


def _bus_line(bus: Bus, model: RobotModel, now_s: float) -> Text:
    line = Text().append(f"bus {bus.name}", "bold")
    statistics, at_s = bus.statistics, bus.statistics_s
    if statistics is None or at_s is None:
        return line.append("  nothing heard yet", _STALE)
    stale = now_s - at_s > STALE_S
    line.append(f"  {statistics.mode} {statistics.port} {_baud(statistics.baud_rate)}")
    if not statistics.connected:
        line.append("  NOT CONNECTED", "bold red")
    if statistics.mode == "poll":  # else the cycles are another master's
        line.append(f"  {statistics.cycle_rate:.1f} Hz")
    line.append(f"  load {statistics.bus_load:.0%}")
    line.append(f"  loss {_percent(bus.loss)}", _loss_style(bus.loss))
    if stale:
        line.stylize(_STALE)
        line.append(f"  {_duration(now_s - at_s)} old", "magenta")
    for fault in model.faults(*_SHOWN_STATUSES):
        if fault.component in (component.bus(bus.name), component.adapter(bus.name)) or (
            fault.component == component.supply(bus.name)
        ):
            line.append(f"  {fault.code}", _style(fault))
    return line


class _Marks:
    """Which servos and cables of a bus have which faults."""

    def __init__(self, bus: Bus, model: RobotModel) -> None:
        faults = [f for f in model.faults(*_SHOWN_STATUSES) if not f.inhibited_by]
        self.servos: dict[int, list[FaultRecord]] = {}
        self.cables: dict[int, list[FaultRecord]] = {}
        before: int | None = None
        for servo_id in bus.servos:
            servo_path = component.servo(bus.name, servo_id)
            cable_path = component.cable(bus.name, before, servo_id)
            self.servos[servo_id] = [f for f in faults if f.component == servo_path]
            self.cables[servo_id] = [f for f in faults if f.component == cable_path]
            before = servo_id

    def cable(self, servo_id: int) -> tuple[str, str]:
        """Sign and style of the cable that leads to a servo."""
        faults = self.cables[servo_id]
        return ("╳", _worst(faults)) if faults else ("│", "dim")

    def dot(self, servo: Servo, now_s: float) -> tuple[str, str]:
        """Sign and style of a servo."""
        faults = self.servos[servo.config.id]
        if faults:
            return "●", _worst(faults)
        if _silent(servo, now_s):
            return "○", _STALE
        return ("●", "bold red") if servo.alert else ("●", "green")

    def codes(self, servo_id: int) -> list[tuple[str, str]]:
        """Codes and styles of the faults at a servo and at the cable that leads to it."""
        return [
            (fault.code, _style(fault)) for fault in self.cables[servo_id] + self.servos[servo_id]
        ]


def _table(bus: Bus, marks: _Marks, now_s: float, width: int) -> list[Text]:
    """A line for each servo; roles have the room that faults leave them."""
    servos = [servo.config for servo in bus.servos.values()]
    model_width = min(max([_MODEL, *(len(servo.model) for servo in servos)]), _LONGEST_MODEL)
    codes = max([0, *(sum(len(code) + 1 for code, _ in marks.codes(s.id)) for s in servos)])
    room = width - _NUMBERS - model_width - codes
    role_width = max(_ROLE, min(room, max([0, *(len(servo.role) for servo in servos)])))
    head = Text(
        f"    id {'model':<{model_width}} {'role':<{role_width}} {'Hz':>5} {'ms':>5} "
        f"{'loss':>5} {'rad':>6} {'V':>4} {'°C':>3}",
        style="dim",
    )
    lines = [head]
    for servo_id, servo in bus.servos.items():
        line = Text(" ").append(*marks.cable(servo_id)).append(*marks.dot(servo, now_s))
        style = _STALE if _silent(servo, now_s) else ""
        line.append(f"{servo_id:>3} ", style or "bold")
        line.append(f"{_fit(servo.config.model, model_width)} ", style or "dim")
        line.append(f"{_fit(servo.config.role, role_width)} ", style)
        line.append(f"{_rate(servo, now_s):>5} ", style)
        line.append(f"{_milliseconds(servo.response_s):>5} ", style)
        line.append(f"{_percent(servo.loss):>5} ", style or _loss_style(servo.loss))
        for name, form, age_s in (
            ("position", "{:+6.3f}", _SILENT_S),
            ("voltage", "{:4.1f}", _VALUE_STALE_S),
            ("temperature", "{:3.0f}", _VALUE_STALE_S),
        ):
            column = len(form.format(0.0))
            value, at_s = servo.values.get(name, (math.nan, now_s))
            text = f"{'-':>{column}}" if math.isnan(value) else _number(form, value, column)
            line.append(f"{text} ", _STALE if now_s - at_s > age_s else style)
        for code, code_style in marks.codes(servo_id):
            line.append(f"{code} ", code_style)
        lines.append(line)
    return lines


def _compact(bus: Bus, marks: _Marks, now_s: float, width: int) -> list[Text]:
    """Several servos a line: the chain runs down each column."""
    servos = list(bus.servos.items())
    columns = max(1, width // _CELL)
    rows = math.ceil(len(servos) / columns)
    lines = [Text() for _ in range(rows)]
    for number, (servo_id, servo) in enumerate(servos):
        cell = Text(" ").append(*marks.cable(servo_id)).append(*marks.dot(servo, now_s))
        codes = marks.codes(servo_id)
        style = codes[0][1] if codes else (_STALE if _silent(servo, now_s) else "")
        numbers = f"{_rate(servo, now_s):>5} {_milliseconds(servo.response_s):>5}ms"
        cell.append(f"{servo_id:>3} ", "bold")
        cell.append(f"{_fit(codes[0][0] if codes else numbers, _CELL - 8)}", style)
        cell.append(" ")
        lines[number % rows].append_text(cell)
    return lines


def _faults(model: RobotModel, width: int) -> list[Text]:
    """Active faults with message and remedy, then those that follow from them, then healed ones."""
    health = model.health
    if health is None:
        return []
    lines: list[Text] = []
    active = model.faults(*_SHOWN_STATUSES)
    for fault in active:
        if not fault.inhibited_by:
            lines += _fault(fault, health, width)
    for fault in active:
        if fault.inhibited_by:
            where = f"{fault.code}, {in_words(fault.component)}"
            cause_path, _, cause = fault.inhibited_by.rpartition("/")
            text = f"   {where}: follows from {cause}, {in_words(cause_path)}"
            lines.append(Text(text, "dim"))
    for fault in model.faults("healed"):
        times = f" ({fault.occurrences} times)" if fault.occurrences > 1 else ""
        lines.append(
            Text(
                f" ✓ healed {_duration((health.stamp - fault.last) / 1e9)} ago: {fault.code}, "
                f"{in_words(fault.component)}{times}",
                style=_STALE,
            )
        )
    return lines


def _fault(fault: FaultRecord, health: Health, width: int) -> list[Text]:
    style = _style(fault)
    head = Text(" ").append("▲ ", style).append(fault.code, style)
    head.append(f"  {fault.confidence:.0%}  since {clock_time(fault.first)[:8]}")
    head.append(f", {_duration((health.stamp - fault.first) / 1e9)}")
    if fault.status == "pending":
        head.append("  not confirmed yet", "yellow")
    if fault.status == "unknown":
        head.append(f"  its source {fault.source} is silent", "magenta")
    if fault.acknowledged:
        head.append("  acknowledged", "dim")
    body = [
        *_wrapped(fault.message, "   ", "", width),
        *_wrapped(fault.remedy, "   → ", "cyan", width),
    ]
    if fault.suspects:
        others = "; ".join(in_words(each) for each in fault.suspects)
        body += _wrapped(f"It may also be {others}.", "   ", "dim", width)
    if fault.status == "unknown":
        for line in body:
            line.stylize(_STALE)
    return [head, *body]


def _wrapped(text: str, indent: str, style: str, width: int) -> list[Text]:
    lines = textwrap.wrap(
        text,
        max(width, len(indent) + 10),
        initial_indent=indent,
        subsequent_indent=" " * len(indent),
    )
    return [Text(line, style) for line in lines]


def _services(health: Health | None, width: int) -> list[Text]:
    """All of them, or, where they do not fit, how many are ready and all the others."""
    if health is None or not health.services:
        return []
    ready = [service for service in health.services if service.status == "ready"]
    others = [service for service in health.services if service.status != "ready"]
    line = _service_line(others + ready)
    if line.cell_len > width:
        line = _service_line(others).append(f"  {len(ready)} ready", "green")
    return [line]


def _service_line(services: list[ServiceHealth]) -> Text:
    line = Text("services", style="dim")
    for service in services:
        line.append(f"  {service.name} ", "")
        line.append(service.status, _SERVICE_STYLE.get(service.status, "bold red"))
        if service.reason:
            line.append(f" ({service.reason})", "dim")
        if service.lost or service.overrun:
            line.append(f" {service.lost + service.overrun} lost", "yellow")
    return line


def _style(fault: FaultRecord) -> str:
    return _UNKNOWN if fault.status == "unknown" else _SEVERITY_STYLE[fault.severity]


def _worst(faults: list[FaultRecord]) -> str:
    return min(map(_style, faults), key=_WORST_FIRST.index)


def _silent(servo: Servo, now_s: float) -> bool:
    return servo.answered_s is None or now_s - servo.answered_s > _SILENT_S


def _rate(servo: Servo, now_s: float) -> str:
    """Hz of its answers, or for how long there was none."""
    if servo.answered_s is None:
        return "never"
    return _duration(now_s - servo.answered_s) if _silent(servo, now_s) else f"{servo.hz:.1f}"[:5]


def _number(form: str, value: float, width: int) -> str:
    """With as many decimals as there is room for; where it is too long without, its magnitude."""
    text = form.format(value)
    if len(text.partition(".")[0]) > width:
        return f"{value:+.0e}"
    return f"{text[:width].rstrip('.'):>{width}}"


def _fit(text: str, width: int) -> str:
    return f"{text:<{width}}" if len(text) <= width else text[: width - 1] + "…"


def _milliseconds(time_s: float | None) -> str:
    return "-" if time_s is None else f"{time_s * 1e3:.2f}"[:5]


def _percent(share: float | None) -> str:
    if share is None:
        return "-"
    return f"{share:.1%}" if share < 0.0995 else f"{share:.0%}"


def _loss_style(loss: float | None) -> str:
    if loss is None or loss < 0.001:  # ordinary on TTL
        return ""
    return "yellow" if loss < 0.5 else "red"


def _baud(baud_rate: int) -> str:
    return (
        f"{baud_rate / 1e6:g} Mbit/s" if baud_rate >= 1_000_000 else f"{baud_rate / 1e3:g} kbit/s"
    )


def _duration(seconds: float) -> str:
    seconds = max(0.0, seconds)
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.0f} h"
