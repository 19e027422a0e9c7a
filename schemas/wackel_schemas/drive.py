"""Messages of the drive: sensors and commands in, pose and twist out, and what to leave out.

SI units and radians. Robot frame: x forward, y left, angles counter-clockwise (REP-103). The pose
is that of the robot in the frame where it was last reset, heading from -pi to pi. Covariances are
3 × 3, row by row, in the order x, y, heading and vx, vy, omega.
"""

from typing import Literal

from wackel_schemas.message import Message, Record

Result = Literal["used", "rejected", "excluded", "missing"]


class ImuSample(Message, kw_only=True):
    """One sample of an inertial sensor (``imu/<name>``).

    Attributes:
        angular_velocity: About the sensor's own x, y and z, rad/s.
        linear_acceleration: Along them, m/s²; absent if it measures none.
        temperature: °C; absent if it measures none.
        late_s: How much later than usual it came, so that it may be of a time so much after the
            stamp.
    """

    angular_velocity: tuple[float, float, float]
    linear_acceleration: tuple[float, float, float] | None = None
    temperature: float | None = None
    late_s: float = 0.0


class TwistCommand(Message, kw_only=True):
    """The velocity that the user's control asks of the drive (``command/twist``).

    Attributes:
        vx, vy: m/s.
        omega: rad/s.
    """

    vx: float
    vy: float
    omega: float


class Exclusion(Record, kw_only=True):
    """One component that must not be believed.

    Attributes:
        component: Path of a wheel's drive, its steering, or a gyro
            (:mod:`wackel_schemas.component`). A drive costs the wheel's rolling, a steering the
            whole wheel.
        fault: ``sensor``: only the value is wrong, the robot moves as it should; ``actuator``: the
            robot really slips, so the other wheels are believed less, too.
        reason: Why, for people.
    """

    component: str
    fault: Literal["sensor", "actuator"]
    reason: str


class Exclusions(Message, kw_only=True):
    """All components that must not be believed (``exclusions``); latched.

    Each message replaces the one before, so a component that is no longer named is believed again.
    Odometry obeys from its next step on, and keeps the last word of a diagnoser that falls silent:
    a wheel does not heal by that.

    Attributes:
        excluded: Empty: everything is to be believed.
    """

    excluded: list[Exclusion] = []


class InputState(Record, kw_only=True):
    """What one measurement was worth in the latest step.

    Attributes:
        name: ``wheel/<name>/roll`` and ``wheel/<name>/slide`` (m/s), ``gyro/<name>`` (rad/s).
        result: ``used``; ``rejected`` by its gate; ``excluded`` by the diagnoser; ``missing``.
        innovation: How far it is from what the prediction and all other inputs say.
        sigma: Standard deviation that this should have; the gate is at four of them.
        rejections: How often its gate has rejected it since the start.
    """

    name: str
    result: Result
    innovation: float | None = None
    sigma: float | None = None
    rejections: int = 0


class GyroState(Record, kw_only=True):
    """What is known of a gyro.

    Attributes:
        name: As configured.
        bias: What it shows at rest, rad/s.
        sigma: Standard deviation of that.
    """

    name: str
    bias: float
    sigma: float


class WheelSlip(Record, kw_only=True):
    """How a wheel's contact moves over the floor; 0 for one that rolls as it should.

    Attributes:
        name: As configured.
        along: Rolling speed minus speed over the floor along the wheel, m/s; absent if unknown.
        across: Speed over the floor along the axle, m/s; absent if unknown, or if the wheel does
            not resist it.
    """

    name: str
    along: float | None = None
    across: float | None = None


class Odometry(Message, kw_only=True):
    """Where the robot is and how it moves (``odometry``), once for each step of the wheels.

    The stamp is the end of the step. Steps are of 7 ms at least: of states at 200 Hz, every other
    ends one. That is 100 times a second, of which whoever follows a path needs 20 to 50; for the
    time in between, the twist tells where the robot goes on.

    Attributes:
        x, y, theta: Pose, m and rad.
        vx, vy, omega: Twist in the robot's own frame, mean of the step, m/s and rad/s.
        pose_covariance, twist_covariance: 9 numbers each.
        valid: Whether pose and twist rest on enough measurements.
        reason: Why not.
        age_s: Time since the last step that had wheels, as of the newest sample of any sensor.
        standing: Whether wheels and gyros agree that the robot stands still.
        gyros: Bias of each.
        inputs: One for each measurement.
        slip: One for each wheel.
        excluded: What the diagnoser has excluded.
        discarded: Samples that came to nothing, by ``<source>: <reason>``, since the start.
        restarts: How often time was started anew after a gap or a step of the clock.
    """

    x: float
    y: float
    theta: float
    vx: float
    vy: float
    omega: float
    pose_covariance: list[float]
    twist_covariance: list[float]
    valid: bool
    reason: str = ""
    age_s: float = 0.0
    standing: bool = False
    gyros: list[GyroState] = []
    inputs: list[InputState] = []
    slip: list[WheelSlip] = []
    excluded: list[Exclusion] = []
    discarded: dict[str, int] = {}
    restarts: int = 0


class OdometryRequest(Record, kw_only=True):
    """A query on ``odometry/request``.

    Attributes:
        operation: ``get`` the latest; ``reset`` the pose to the origin, exactly; ``set_pose`` to
            what is given. Twist and biases stay.
        x, y, theta: m and rad.
        position_sigma, heading_sigma: How well that is known, standard deviations.
    """

    operation: Literal["get", "reset", "set_pose"] = "get"
    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0
    position_sigma: float = 0.0
    heading_sigma: float = 0.0


class PoseSet(Message, kw_only=True):
    """The pose was set by a request (``odometry/pose_set``), so that a recording has it, too.

    Attributes:
        request: What was asked and done.
    """

    request: OdometryRequest


class OdometryReply(Message, kw_only=True):
    """Answer to an odometry request.

    Attributes:
        ok: Whether it was done.
        text: What was done, or why not.
        odometry: The latest; absent before the first step.
    """

    ok: bool
    text: str
    odometry: Odometry | None = None
