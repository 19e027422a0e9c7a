"""Messages of a servo bus: raw transactions, decoded state, statistics, requests, commands.

Times within a transaction are ns on the monotonic clock, relative to the transaction's stamp, so
that a step of the wall clock cannot bend a response time.
"""

from typing import Literal

from wackel_schemas.message import Message, Record

Purpose = Literal["cycle", "ping", "background", "command", "request", "observed"]


class Chunk(Record, kw_only=True):
    """Bytes as the operating system delivered them in one read.

    Attributes:
        at_ns: When the read returned, ns after the transaction's stamp.
        data: The bytes, untouched.
    """

    at_ns: int
    data: bytes


class ResponseTime(Record, kw_only=True):
    """How long one servo took.

    Attributes:
        id: The servo.
        ns: From the last byte of the instruction to the chunk with the answer's last byte.
    """

    id: int
    ns: int


class Transaction(Message, kw_only=True):
    """One instruction and everything on the bus until the next (``bus/<bus>/transaction``).

    The stamp is when the first byte of the instruction left the host, or, where there is no
    instruction (unsolicited bytes), when the first chunk came.

    Attributes:
        purpose: Why it was sent: the cycle's read, a follow-up ping, slow background work, a
            command, a request of a user, or somebody else's traffic that was observed.
        instruction: The instruction packet as sent, stuffed and with its CRC; empty if none.
        sent_ns: When the last byte of the instruction left.
        chunks: What came, in order.
        expected: Ids of the servos that have to answer, in the order of their answers.
        expected_bytes: Length of all the answers together if none is stuffed.
        deadline_ns: Until when the answers had to be complete.
        ended_ns: When listening ended: completed, or given up.
        response_times: One for each intact status packet of an expected servo.
        host_lag_ns: By how much the host itself was late in this transaction (longest
            oversleeping of the process), to tell its hiccups from bus trouble.
        late_ns: How much later the answers came than usual ones of this bus (mean and four mean
            deviations), without that; 0 if they were not late, or nothing came.
        baud_rate: Bit/s.
    """

    purpose: Purpose
    instruction: bytes
    sent_ns: int
    chunks: list[Chunk]
    expected: list[int]
    expected_bytes: int
    deadline_ns: int
    ended_ns: int
    baud_rate: int
    response_times: list[ResponseTime] = []
    host_lag_ns: int = 0
    late_ns: int = 0

    def received(self) -> bytes:
        """All the bytes that came, as one string."""
        chunks = self.chunks
        return chunks[0].data if len(chunks) == 1 else b"".join(chunk.data for chunk in chunks)


class ServoState(Record, kw_only=True):
    """Registers of one servo in SI units. What was not received in this cycle is absent.

    Attributes:
        id: The servo.
        position: rad, zero at the centre of the model's range.
        velocity: rad/s.
        current: A.
        load: Share of the maximal torque, -1 … 1 (models that report load, not current).
        pwm: Share of the supply voltage, -1 … 1.
        voltage: V, at the servo's own connector.
        temperature: °C.
        torque_enabled: Whether the motor is driven.
        hardware_error: Hardware Error Status register, bits as in the e-manual.
        alert: The alert bit of the status packet.
        error: Number of the error of the status packet (0: none).
    """

    id: int
    position: float | None = None
    velocity: float | None = None
    current: float | None = None
    load: float | None = None
    pwm: float | None = None
    voltage: float | None = None
    temperature: float | None = None
    torque_enabled: bool | None = None
    hardware_error: int | None = None
    alert: bool = False
    error: int = 0


class BusState(Message, kw_only=True):
    """What the servos said in one transaction (``bus/<bus>/state``); one that is silent is absent.

    Attributes:
        servos: In the order of the answers.
        late_s: How much later than usual these came. Whether the adapter held back them or the
            instruction is not known, so the values may be of a time so much after the stamp.
        asked_again: Whether others before these did not answer, so that these were asked once more,
            with another instruction than usual. A servo may read its registers when its turn to
            answer comes, so the values may be of times that differ, by milliseconds and from servo
            to servo, from those of usual states.
    """

    servos: list[ServoState]
    late_s: float = 0.0
    asked_again: bool = False


class ServoStatistics(Record, kw_only=True):
    """Counters of one servo since boot.

    Attributes:
        id: The servo.
        expected: Answers it owed.
        received: Answers that came intact.
        bad_crc: Answers recognisably its own that came damaged.
        alerts: Answers with the alert bit.
        errors: Answers with an error number.
        response_p50: Median of its latest 256 response times, s: asked alone, from the last byte
            of the instruction until the answer, less the time of the answer's bytes on the wire.
            Absent until it has been asked alone.
        response_p95: 95th percentile of these.
        response_p99: 99th percentile.
        response_outliers: Response times that departed from what was usual for it.
    """

    id: int
    expected: int = 0
    received: int = 0
    bad_crc: int = 0
    alerts: int = 0
    errors: int = 0
    response_p50: float | None = None
    response_p95: float | None = None
    response_p99: float | None = None
    response_outliers: int = 0


class BusStatistics(Message, kw_only=True):
    """Counters and rates of a bus since boot (``bus/<bus>/statistics``).

    Attributes:
        mode: How the gateway owns the bus: poll, proxy or tap.
        port: Path of the serial port.
        connected: Whether the port is open.
        baud_rate: Bit/s.
        transactions: Count.
        incomplete: Transactions in which at least one expected answer was missing.
        bytes_sent: Count.
        bytes_received: Count; the sum of packet, bad, zero and stray bytes below.
        packet_bytes: Bytes in valid packets.
        bad_bytes: Bytes in packets with a wrong CRC and in truncated ones.
        zero_bytes: Runs of 0x00 outside packets.
        stray_bytes: All other bytes outside packets.
        cycle_rate: Hz, over the last period.
        cycle_time: Median over the last period, s.
        bus_load: Share of the last period that bytes took on the wire, 0 … 1.
        latency_timer_ms: USB latency timer as read back; absent where the driver tells none.
        fast_sync_read: Whether the cycle uses Fast Sync Read.
        reconnects: How often the adapter came back.
        overruns: UART and buffer overruns that the driver counted; absent where it counts none.
        commands: Goal writes sent.
        timed_out: Goals that became 0, because nobody renewed them in time.
        rejected: Commands and requests refused, by reason.
        servos: In cable order.
    """

    mode: Literal["poll", "proxy", "tap"]
    port: str
    connected: bool
    baud_rate: int
    transactions: int = 0
    incomplete: int = 0
    bytes_sent: int = 0
    bytes_received: int = 0
    packet_bytes: int = 0
    bad_bytes: int = 0
    zero_bytes: int = 0
    stray_bytes: int = 0
    cycle_rate: float = 0.0
    cycle_time: float = 0.0
    bus_load: float = 0.0
    latency_timer_ms: int | None = None
    fast_sync_read: bool = False
    reconnects: int = 0
    overruns: int | None = None
    commands: int = 0
    timed_out: int = 0
    rejected: dict[str, int] = {}
    servos: list[ServoStatistics] = []


class ServoGoal(Record, kw_only=True):
    """Goal values of one servo; what is absent stays as it is. Units as in :class:`ServoState`."""

    id: int
    position: float | None = None
    velocity: float | None = None
    current: float | None = None
    pwm: float | None = None
    torque_enabled: bool | None = None


class BusCommand(Message, kw_only=True):
    """Goal values for the next cycle (``bus/<bus>/command``).

    Attributes:
        goals: Of one servo each.
        timeout_s: For how long they hold, up to 3600: then, or when the gateway ends before,
            velocity, current and PWM goals become 0, unless others have come for the same servo. So
            the robot stops where what commands it has died. Absent: until there are others, as
            servos do it.
    """

    goals: list[ServoGoal]
    timeout_s: float | None = None


class BusRequest(Record, kw_only=True):
    """Run one instruction on the bus (query on ``bus/<bus>/request``).

    Attributes:
        operation: What to do. ``raw`` sends ``instruction`` with ``parameters``; ``read`` and
            ``write`` use ``register`` or ``address``; the others need only ``id``.
        id: The servo; 254 for all where the protocol allows it.
        register: Name of a register of the model's control table.
        address: Instead of a name.
        length: Bytes to read at ``address``.
        value: What to write, as the raw register value.
        instruction: Number of the instruction of ``raw``.
        parameters: Parameters of ``raw``, unstuffed.
        answers: Ids that will answer ``raw``.
    """

    operation: Literal["ping", "read", "write", "reboot", "factory_reset", "scan", "raw"]
    id: int = 254
    register: str | None = None
    address: int | None = None
    length: int | None = None
    value: int | None = None
    instruction: int | None = None
    parameters: bytes = b""
    answers: list[int] = []


class BusReply(Message, kw_only=True):
    """Answer to a request.

    Attributes:
        ok: Whether the bus did what was asked.
        text: What happened, in words.
        value: Raw value of a register that was read.
        ids: Servos that answered.
        transaction: What went over the wire (the last exchange if it took several).
    """

    ok: bool
    text: str
    value: int | None = None
    ids: list[int] = []
    transaction: Transaction | None = None
