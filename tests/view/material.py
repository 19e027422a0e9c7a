"""Messages to look at."""

from tests.odometry.simulation import BUS, START_NS, steered_drive
from wackel_node.config import BusConfig, RobotConfig, ServoConfig
from wackel_schemas.drive import InputState, Odometry
from wackel_schemas.health import FaultRecord, FaultStatus, Health, ServiceHealth
from wackel_schemas.residuals import Candidate, Residuals

CONFIG = RobotConfig(
    robot="testbot",
    buses={BUS: BusConfig(port="p", servos=[ServoConfig(id=i) for i in (0, 1, 2, 100, 101, 102)])},
    drive=steered_drive(3),
)


def odometry(after_s: float = 0.0, x: float = 0.0, vx: float = 0.5, **changes: object) -> Odometry:
    """Where the robot is."""
    fields: dict[str, object] = {
        "stamp": START_NS + round(after_s * 1e9),
        "x": x,
        "y": 0.0,
        "theta": 0.0,
        "vx": vx,
        "vy": 0.0,
        "omega": 0.1,
        "pose_covariance": [0.0] * 9,
        "twist_covariance": [0.0] * 9,
        "valid": True,
        "inputs": [InputState(name=f"wheel/w{i}/roll", result="used") for i in range(3)],
    }
    return Odometry(**(fields | changes))  # type: ignore[arg-type]


def residuals(after_s: float = 0.0) -> Residuals:
    """What the diagnoser sees of a wheel that does not do what it should."""
    return Residuals(
        stamp=START_NS + round(after_s * 1e9),
        commanded=[0.5, 0.0, 0.1],
        candidates=[
            Candidate(name="(1,2;1)", vx=0.5, vy=0.0, omega=0.1),
            Candidate(name="(1,2;2)", vx=0.1, vy=0.0, omega=0.1, deviates=True),
            Candidate(name="(1,3;1)", singular="B"),
        ],
        signature="010000",
    )


def fault(code: str, component: str, status: FaultStatus = "confirmed") -> FaultRecord:
    """A fault in health."""
    return FaultRecord(
        code=code,
        component=component,
        source="diagnoser",
        severity="fault",
        status=status,
        message=f"{component} has {code}.",
        remedy="Repair it.",
        confidence=1.0,
        first=START_NS,
        last=START_NS,
    )


def health(*faults: FaultRecord, gateway: str = "ready") -> Health:
    """Health with these faults."""
    return Health(
        stamp=START_NS,
        level="fault" if faults else "ok",
        summary=faults[0].message if faults else "All well.",
        capabilities={"can_drive": not faults},
        faults=list(faults),
        services=[ServiceHealth(name="gateway/main", status=gateway, since=0)],  # type: ignore[arg-type]
    )
