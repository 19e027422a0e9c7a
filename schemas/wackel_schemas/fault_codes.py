"""All fault codes in one table: what each means, how bad it is, and what to do about it.

A report's ``message`` and ``remedy`` are made from here, so that no code lacks either.
"""

from dataclasses import dataclass
from typing import Literal

from wackel_schemas.component import in_words


@dataclass(frozen=True)
class FaultCode:
    """What is known of a kind of fault before one occurs.

    Attributes:
        text: A plain sentence; ``{component}`` is put in words, other names come from the report.
        remedy: What to do, in the order in which to try it.
        severity: ``info`` (worth knowing), ``warning`` (still works), ``fault``.
        disables: Capabilities that are lost while it is confirmed.
        debounce_s: How long it must be reported before it counts as confirmed; 0 where the
            source decides by statistics of its own.
        heal_s: How long it must be gone before it counts as healed.
        window_s: The longest time that its source may need to find it again after a restart.
    """

    text: str
    remedy: str
    severity: Literal["info", "warning", "fault"]
    disables: tuple[str, ...] = ()
    debounce_s: float = 0.0
    heal_s: float = 0.5
    window_s: float = 5.0


_CHAIN = ("can_command",)
_WHEELS = ("can_drive",)

FAULT_CODES: dict[str, FaultCode] = {
    # The wire.
    "lost_signal": FaultCode(
        "Nothing answers on {component}: no power, or a cable or the first servos are "
        "disconnected; the bus alone cannot tell which.",
        "Check the supply and its switch, then the cable from the adapter to the first servo, then "
        "each further cable. The LED of every powered servo flashes once when power is switched "
        "on: the first dark one is behind the fault.",
        "fault",
        _CHAIN,
    ),
    "no_power": FaultCode(
        "The servos on {component} have no power.",
        "Check battery, supply, fuse, emergency stop and the power connector of the chain.",
        "fault",
        _CHAIN,
    ),
    "cable_break": FaultCode(
        "{component} is disconnected: no servo behind it answers.",
        "Push both plugs of this cable home; if that does not help, exchange the cable.",
        "fault",
        _CHAIN,
    ),
    "servo_silent": FaultCode(
        "{component} does not answer, though servos behind it in the chain do.",
        "Check that its id, baud rate and protocol are right (wackel scan); power-cycle it. If it "
        "stays silent, exchange the servo.",
        "fault",
        _CHAIN,
    ),
    "servo_unheard": FaultCode(
        "{component} has given no intact answer for a second; why is not known yet.",
        "Wait some seconds for the cause to be named. If none is, check the servo's two plugs and "
        "its supply, and take load off the computer if that is late (host_lag).",
        "fault",
        _CHAIN,
    ),
    "duplicate_id": FaultCode(
        "{component} is there twice: two servos with this id answer at once.",
        "Unplug one of the two, give the other one an id of its own, and plug the first in again. "
        "With only half of the chain plugged in, wackel scan shows in which half each of them is. "
        "If there is only one, exchange it.",
        "fault",
        _CHAIN,
    ),
    "loose_contact": FaultCode(
        "{component} has a loose contact: the connection comes and goes.",
        "Reseat both plugs of this cable and move it while watching the loss; exchange the cable "
        "or its crimp contacts, and relieve it from strain.",
        "fault",
        _CHAIN,
        window_s=15.0,
    ),
    "rhythmic_jammer": FaultCode(
        "Something on {component} pulls the bus low between packets: a zero byte stands before and "
        "after every answer (rhythmic jammer).",
        "Unplug servos one after the other until the zeros are gone; the last one unplugged is "
        "damaged. Also check the bus supply and, on RS-485, the termination.",
        "warning",
    ),
    "permanent_jammer": FaultCode(
        "Something on {component} writes on the bus without pause (permanent jammer).",
        "Unplug servos one after the other until the stream stops; the last one unplugged is "
        "damaged and has to be exchanged.",
        "fault",
        _CHAIN,
    ),
    "stray_data": FaultCode(
        "Bytes that belong to no packet appear on {component}.",
        "Look for moving cables, missing common ground and strong motors near the data line. If "
        "it recurs, wackel will name a place.",
        "warning",
        heal_s=5.0,
    ),
    "noise": FaultCode(
        "Packets of all servos on {component} are damaged now and then, independent of place.",
        "Check common ground, shielding and termination; shorten the bus or lower the baud rate.",
        "warning",
        window_s=15.0,
    ),
    "packet_loss": FaultCode(
        "{component} loses more answers than ordinary loss explains.",
        "Check its two plugs and its supply; compare the loss when the robot stands still.",
        "warning",
        window_s=30.0,
    ),
    "crc_errors": FaultCode(
        "Answers of {component} arrive damaged more often than ordinary loss explains.",
        "Check its two plugs; if the neighbours are clean, exchange the cable, then the servo.",
        "warning",
        window_s=30.0,
    ),
    # Time.
    "slow_servo": FaultCode(
        "{component} answers later than it should and than its peers do.",
        "Read its Return Delay Time; update its firmware; if it stays slow, exchange it.",
        "warning",
        window_s=15.0,
    ),
    "return_delay": FaultCode(
        "The Return Delay Time register of {component} holds {held}; it should hold {expected}.",
        "Write that to it with the torque off: wackel servo write ID return_delay_time VALUE. If "
        "it is right as it is, correct return_delay_us in robot.toml.",
        "warning",
    ),
    "latency_timer": FaultCode(
        "{component} delivers answers in steps of milliseconds: its USB latency timer is not set.",
        "Set latency_timer to 1 (udev rule in compose/udev, or wackel doctor), then plug it again.",
        "warning",
        window_s=15.0,
    ),
    "host_lag": FaultCode(
        "The computer itself was late in serving {component}; the bus is not to blame.",
        "Give the gateway real-time priority (compose/systemd) or take load off the computer.",
        "info",
        heal_s=5.0,
    ),
    "adapter_lag": FaultCode(
        "{component} held answers back now and then; its cables and servos are not to blame.",
        "Look whether the computer is too busy (load, governor, swapping); else plug the adapter "
        "into a port of its own, without a hub; look into dmesg; exchange its USB cable.",
        "info",
        heal_s=5.0,
    ),
    # What servos say of themselves.
    "undervoltage": FaultCode(
        "{component} reports that its input voltage is out of limits.",
        "Charge or exchange the battery; check the supply cable. A reboot of the servo clears it.",
        "fault",
        _CHAIN,
    ),
    "overheating": FaultCode(
        "{component} reports that it is too hot.",
        "Let it cool, reduce its load, then reboot it.",
        "fault",
        _CHAIN,
    ),
    "encoder_error": FaultCode(
        "{component} reports that its encoder fails.",
        "Reboot it; if it comes again, the servo has to be repaired.",
        "fault",
        _CHAIN,
    ),
    "hall_sensor_error": FaultCode(
        "{component} reports that its Hall sensor fails.",
        "Reboot it; if it comes again, the servo has to be repaired.",
        "fault",
        _CHAIN,
    ),
    "electrical_shock": FaultCode(
        "{component} reports an electrical shock or too little power for its motor.",
        "Check its supply cable and for short circuits, then reboot it.",
        "fault",
        _CHAIN,
    ),
    "overload": FaultCode(
        "{component} is overloaded and has switched its torque off.",
        "Remove what blocks it, then reboot the servo: only that restores torque.",
        "fault",
        _CHAIN,
    ),
    "alert": FaultCode(
        "{component} reports a hardware error that could not be read yet.",
        "Read its Hardware Error Status; power-cycle it if it cannot be read.",
        "fault",
        _CHAIN,
    ),
    "instruction_error": FaultCode(
        "{component} refuses instructions ({error}).",
        "Check the model and firmware given for it in robot.toml against wackel scan.",
        "warning",
    ),
    "contact_resistance": FaultCode(
        "The voltage drops at {component}: a contact there has a high resistance.",
        "Clean or exchange the power contacts of this cable; use thicker wire.",
        "warning",
        window_s=30.0,
    ),
    "low_supply": FaultCode(
        "{component} delivers too little voltage to all servos.",
        "Charge the battery or check the supply. Servos that have raised an alert keep it until "
        "they are rebooted (wackel servo reboot all).",
        "warning",
    ),
    "frozen_values": FaultCode(
        "{component} keeps sending exactly the same values although it should change.",
        "Check its data cable, then reboot it.",
        "warning",
        window_s=30.0,
    ),
    "unexpected_servo": FaultCode(
        "{component} answers but is not in robot.toml.",
        "Add it to robot.toml, or find out who has its id twice.",
        "warning",
    ),
    "unclassified": FaultCode(
        "{component} misbehaves in a way that fits no known fault.",
        "Look at the evidence; record the bus (wackel record) and check cables and supply.",
        "warning",
    ),
    # Gyro and odometry.
    "gyro_bias": FaultCode(
        "{component} shows {bias} rad/s at rest, more than its data sheet allows.",
        "Let it warm up at rest; if it stays so, check gyros.*.axis and bias_limit in robot.toml, "
        "then exchange the sensor.",
        "warning",
        debounce_s=1.0,
    ),
    "gyro_saturated": FaultCode(
        "{component} turns faster than it can measure.",
        "Set a larger range on the sensor and in gyros.*.saturation, or turn more slowly.",
        "warning",
        heal_s=2.0,
    ),
    "gyro_frozen": FaultCode(
        "{component} keeps sending exactly the same value although the robot turns.",
        "Check its cable and its driver; restart the driver.",
        "fault",
    ),
    "gyro_absent": FaultCode(
        "{component} is not there: {reason}.",
        "Check its cable, that its driver is loaded (ls /sys/bus/iio/devices), gyros.*.device in "
        "robot.toml, and the permission (udev rule in compose/udev).",
        "fault",
    ),
    "gyro_silent": FaultCode(
        "{component} sends nothing.",
        "Check its cable, its driver, and the name under which the driver publishes.",
        "fault",
        debounce_s=0.5,
    ),
    "gyro_rate": FaultCode(
        "{component} sends {rate} samples a second instead of {nominal}.",
        "Check the rate set in its driver against gyros.*.rate, and the load of the computer.",
        "warning",
        debounce_s=1.0,
        heal_s=2.0,
    ),
    "gyro_time_offset": FaultCode(
        "The stamps of {component} are {offset} off those of the wheels.",
        "Let its driver stamp samples when they are taken, with the computer's own clock, and "
        "publish each at once.",
        "warning",
        window_s=30.0,
    ),
    "bad_input": FaultCode(
        "{component} sends what cannot be: {reason}.",
        "Look at what is published there (wackel echo) and correct its publisher.",
        "warning",
        heal_s=5.0,
    ),
    "late_answers": FaultCode(
        "Answers of {component} come so late that the time they are of is not known; the odometry "
        "goes without them.",
        "Look what holds them up: the adapter's latency timer (wackel doctor), a hub that it "
        "shares, the load of the computer.",
        "warning",
        heal_s=1.0,
    ),
    "pose_unknown": FaultCode(
        "{component} cannot tell where the robot is: {reason}.",
        "See which inputs are missing or excluded (wackel pose); once they are back, say where the "
        "robot is (wackel pose set).",
        "fault",
        ("can_localise",),
        debounce_s=0.5,
        heal_s=0.5,
    ),
    # The drive: table 1 of the paper on kinematic diagnosis, and what it leaves out.
    "wheel_blocked": FaultCode(
        "{component} is blocked: the wheel is dragged over the floor.",
        "Stop. Look for what jams the wheel or its gear; if it turns by hand with the power off, "
        "exchange the servo.",
        "fault",
        _WHEELS,
    ),
    "wheel_sticks": FaultCode(
        "{component} sticks now and then.",
        "Look for hair, thread or a screw in wheel and gear, and for a cable that catches; then "
        "exchange the servo.",
        "fault",
        _WHEELS,
    ),
    "wheel_free": FaultCode(
        "{component} does not drive: the wheel only rolls along.",
        "If the servo's torque is off, see why (overload, supply) and switch it on; else fasten "
        "the wheel on its shaft, then look at the gear.",
        "fault",
        _WHEELS,
    ),
    "wheel_deviates": FaultCode(
        "{component} does not turn as fast as it is told: the wheel slips.",
        "Check the servo's velocity limit, gains and supply, and that the wheel touches the floor.",
        "fault",
        _WHEELS,
    ),
    "wheel_sensor": FaultCode(
        "The speed that {component} shows is wrong; the wheel itself turns as it should.",
        "Restart the servo; if it comes back, exchange it: its encoder is faulty.",
        "fault",
    ),
    "steering_blocked": FaultCode(
        "{component} is blocked: it does not follow.",
        "Stop. Look for what jams it, whether its torque is on, and for a cable that is too short; "
        "if it turns by hand with the power off, exchange the servo.",
        "fault",
        _WHEELS,
    ),
    "steering_offset": FaultCode(
        "{component} stands off what it is told.",
        "Check its load, its gains and its limits; look for what holds it.",
        "fault",
        _WHEELS,
    ),
    "steering_reference": FaultCode(
        "{component} stands {angle} off what it shows: its zero is wrong.",
        "Align the wheel and correct steering_offset in robot.toml; see whether the horn has "
        "slipped on its shaft.",
        "fault",
        heal_s=5.0,
        window_s=60.0,
    ),
    "steering_deviates": FaultCode(
        "{component} shows a little else than it is told: it stands off, or its sensor is.",
        "See by eye whether the wheel stands where it is told to; a motion does not tell half a "
        "degree of one from the other.",
        "fault",
        _WHEELS,
    ),
    "steering_sensor": FaultCode(
        "The angle that {component} shows is wrong; the wheel itself stands as it should.",
        "Restart the servo; if it comes back, exchange it: its encoder is faulty.",
        "fault",
    ),
    "gyro_deviates": FaultCode(
        "{component} contradicts all wheels.",
        "See whether it is loose; let the robot rest for some seconds so that its bias is learnt "
        "anew; then exchange it.",
        "fault",
    ),
    "two_faults": FaultCode(
        "{component} is faulty, together with {others}.",
        "Stop. Two parts at once: look for what they share, a cable, a supply, a blow.",
        "fault",
        _WHEELS,
    ),
    "drive_disturbed": FaultCode(
        "Something acts on {component}: a collision, or wheels that slip on the floor.",
        "Look at what the robot stands against, and at the floor.",
        "warning",
        heal_s=1.0,
    ),
    "command_not_followed": FaultCode(
        "{component} is not what the drive does, though all wheels agree with each other.",
        "See whether something else commands the servos, and whether torque is on; check the "
        "wheels of robot.toml against those of the control.",
        "fault",
        _WHEELS,
    ),
    "command_singular": FaultCode(
        "{component} turns the robot about the contact of wheel {wheel}, where its direction is "
        "not defined.",
        "Let the planner keep the centre of rotation away from the wheels' contacts.",
        "warning",
        heal_s=1.0,
    ),
    "command_infeasible": FaultCode(
        "{component} cannot be driven: {reason}.",
        "Let the planner keep to what the drive can do.",
        "warning",
        debounce_s=0.2,
        heal_s=1.0,
    ),
    # The gateway and the processes.
    "adapter_unplugged": FaultCode(
        "{component} is not there: {reason}.",
        "Plug it in again; check the USB cable and hub, and the permission (wackel doctor).",
        "fault",
        _CHAIN,
    ),
    "bus_quiet": FaultCode(
        "Nobody asks anything on {component}, so nothing is known of its servos.",
        "Start the software that controls the robot, and have it open the port that proxy_port "
        "names; in mode tap check that the second adapter is on the same wires.",
        "warning",
    ),
    "service_dead": FaultCode(
        "{component} is dead: {reason}.",
        "wackel up or systemd restarts it; if it keeps dying, look at its log (where wackel up "
        "runs, or journalctl -u 'wackel-*').",
        "fault",
    ),
    "service_crashed": FaultCode(
        "{component} has failed: {reason}.",
        "Put right what the reason says. If it names a line of code, please report it with a "
        "recording (wackel record); the service is restarted.",
        "fault",
    ),
    "service_hung": FaultCode(
        "{component} is alive but silent.",
        "Look at the load of the computer; restart the service.",
        "fault",
    ),
    "recording_paused": FaultCode(
        "{component} records nothing: {reason}.",
        "Make room on its disk, or name another in recorder.directory; it goes on by itself.",
        "warning",
    ),
    "messages_lost": FaultCode(
        "{component} misses messages: the computer or the network is overloaded.",
        "Take load off the computer, or lower the rate of the buses.",
        "warning",
        debounce_s=1.0,  # one burst lost, as when a service starts, is no overload
        heal_s=5.0,
    ),
    "messages_refused": FaultCode(
        "{component} gets messages that it cannot use: {reason}.",
        "Look at what is published there (wackel echo) and correct or stop its publisher.",
        "warning",
        heal_s=5.0,
    ),
}

# A key that is confirmed explains the faults listed for it, which stay visible but inhibited.
EXPLAINS: dict[str, frozenset[str]] = {
    "adapter_unplugged": frozenset(
        {
            "lost_signal",
            "no_power",
            "cable_break",
            "servo_silent",
            "servo_unheard",
            "loose_contact",
            "packet_loss",
        }
    ),
    "lost_signal": frozenset({"servo_silent", "servo_unheard", "packet_loss"}),
    "no_power": frozenset(
        {"servo_silent", "servo_unheard", "packet_loss", "undervoltage", "low_supply"}
    ),
    "cable_break": frozenset({"servo_silent", "packet_loss"}),
    "duplicate_id": frozenset(
        {
            "lost_signal",
            "cable_break",
            "servo_silent",
            "servo_unheard",
            "loose_contact",
            "packet_loss",
            "crc_errors",
            "stray_data",
        }
    ),
    "loose_contact": frozenset({"packet_loss", "crc_errors", "stray_data"}),
    "permanent_jammer": frozenset(
        {"servo_unheard", "packet_loss", "crc_errors", "stray_data", "noise"}
    ),
    "noise": frozenset({"packet_loss", "crc_errors", "stray_data"}),
    "return_delay": frozenset({"slow_servo"}),
    "latency_timer": frozenset({"slow_servo", "adapter_lag", "late_answers"}),
    "gyro_frozen": frozenset({"gyro_deviates"}),
    "gyro_silent": frozenset({"gyro_rate"}),
    "gyro_absent": frozenset({"gyro_silent", "gyro_rate"}),
}


def message(code: str, component: str, **values: str) -> str:
    """The plain sentence of a fault; starts with a capital letter.

    Raises:
        KeyError: Unknown code, or a value that the text of this code needs is missing.
    """
    text = FAULT_CODES[code].text.format(component=in_words(component), **values)
    return text[0].upper() + text[1:]
