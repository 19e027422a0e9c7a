"""A body on MuJoCo's contact physics (extra ``sim``).

Wheels are ellipsoids, which touch the floor in one point (cylinders chatter on their edges). The
chassis moves in the plane, and soft springs press each wheel on the floor with the same load: in
MuJoCo's convex friction a wheel that slides rises a little, and would lift the others with a stiff
chassis. No drive needs more wheels than it has, either. Unlike those of the fast body, tyres do not
creep: a wheel that grips holds its line exactly. Settings: MuJoCo 4 documentation, "Modeling", on
elliptic cones, impratio and integrators.
"""

import math

import numpy as np

from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_node.config import ConfigError
from wackel_node.errors import FAILED, Explained
from wackel_virtual.body import GRAVITY, MOST_EFFORT, InPlane, WheelStates, World
from wackel_virtual.build import Build

STEP_S = 0.002
"""The longest; a step of the body is a whole number of them."""
MASS_KG = 1.0
"""Of the robot, per wheel; motion does not depend on it, since all forces are by weight."""
WHEEL_SHARE = 0.1
"""Mass of a wheel, with what steers it, by that of the robot per wheel. Lighter wheels hop where
they slide, at steps of this length; with this one a robot that drags a blocked wheel moves as in
steps ten times as short, and as on the fast body."""
ROTOR_SHARE = 0.25
"""Inertia of a motor behind its gear, as a mass at its wheel's rim, by that of the robot per wheel.
As little as that is, for with less the speed of a wheel that slides rings in steps of this length.
The implicit integrators would damp that, but only after contacts have been solved for wheels that
are not damped: the robot then stops before its wheels do."""
SPRING_M = 0.1
"""How far the springs are compressed: a wheel that rises by 1 mm carries 1 % more."""


class NoPhysics(Explained, ImportError):
    """MuJoCo is not installed; the text says what to do."""

    exit_code = FAILED


try:
    import mujoco
except ImportError as error:
    raise NoPhysics(
        "physics 'mujoco' needs MuJoCo: pip install 'wackel[sim]', or choose physics 'fast'"
    ) from error


class MujocoBody:
    """See :class:`~wackel_virtual.body.Body`.

    Args:
        drive: The true wheels.
        heading: Directions in which the wheels stand at first, rad.
        build: What else it is like.

    Raises:
        ConfigError: The drive has wheels with rollers.
    """

    def __init__(self, drive: Drive, heading: list[float], build: Build) -> None:
        if not all(wheel.slide for wheel in drive.wheels):
            raise ConfigError(
                "drive.kind: wheels with rollers have no physics 'mujoco', but 'fast'"
            )
        n = drive.n
        self.pose: InPlane = (0.0, 0.0, 0.0)
        self.twist: InPlane = (0.0, 0.0, 0.0)
        self.angle = [0.0] * n
        self.rate = [0.0] * n
        self.effort = [0.0] * n
        radii = np.full(n, float(np.mean(drive.roll_radius)) if drive.roll_radius.size else 0.05)
        radii[drive.roll_wheels] = drive.roll_radius
        self._model = model = mujoco.MjModel.from_xml_string(_xml(drive, radii, heading, build))
        self._data = mujoco.MjData(model)
        self._mass = n * MASS_KG
        grip = build.friction * MASS_KG * GRAVITY * radii  # N m at which a tyre slips
        self._grip: list[float] = grip.tolist()
        self._gain = np.zeros(n)
        self._gain[drive.roll_wheels] = (grip / (build.droop_m_s / radii))[drive.roll_wheels]
        self._held = [False] * n
        self._driven: list[bool] = []
        self._roll_position = [int(model.joint(f"roll{i}").qposadr[0]) for i in range(n)]
        self._roll_velocity = [int(model.joint(f"roll{i}").dofadr[0]) for i in range(n)]
        self._rotor: list[float] = model.dof_armature[self._roll_velocity].tolist()
        self._gain_now: list[float] = []
        self._wheel = np.array([model.geom(f"wheel{i}").id for i in range(n)])
        self._lock = [model.equality(f"lock{i}").id for i in range(n)]
        self._motor = [int(model.actuator(f"motor{i}").id) for i in range(n)]
        self._steers: list[int] = np.flatnonzero(drive.steers).tolist()
        self._steering = np.array(
            [model.actuator(f"steering{i}").id for i in self._steers], dtype=np.intp
        )
        self._chassis = model.body("chassis").id
        for i in self._steers:
            self._data.qpos[model.joint(f"steer{i}").qposadr[0]] = heading[i]
        mujoco.mj_forward(model, self._data)

    def step(self, wheels: WheelStates, world: World, duration_s: float) -> None:
        """Move on."""
        model, data = self._model, self._data
        if wheels.driven != self._driven:
            self._set_motors(wheels.driven)
        model.geom_friction[self._wheel, 0] = world.friction
        data.ctrl[self._motor] = wheels.rate
        data.ctrl[self._steering] = [wheels.heading[i] for i in self._steers]
        for i, (blocked, held) in enumerate(zip(wheels.blocked, self._held, strict=True)):
            if blocked != held:
                self._set_lock(i, locked=blocked)
        cos, sin = math.cos(self.pose[2]), math.sin(self.pose[2])
        along, left, moment = (self._mass * part for part in world.push)
        force = data.xfrc_applied[self._chassis]
        force[0], force[1] = cos * along - sin * left, sin * along + cos * left
        force[5] = moment

        steps = math.ceil(duration_s / STEP_S - 1e-9)
        model.opt.timestep = duration_s / steps
        mujoco.mj_step(model, data, nstep=steps)

        position, velocity = data.qpos.tolist(), data.qvel.tolist()
        x, y, heading = position[:3]
        vx, vy, omega = velocity[:3]
        cos, sin = math.cos(heading), math.sin(heading)
        self.pose = (x, y, heading)
        self.twist = (cos * vx + sin * vy, cos * vy - sin * vx, omega)
        angle = [position[at] for at in self._roll_position]
        rate = [velocity[at] for at in self._roll_velocity]
        self.effort = self._efforts(wheels.rate, angle, rate, duration_s)
        self.angle, self.rate = angle, rate

    def _efforts(
        self, told: list[float], angle: list[float], rate: list[float], duration_s: float
    ) -> list[float]:
        """Means over a step at the end of which wheels stand and turn like this: a stiff drive has
        caught up with its goal long before."""
        efforts, timestep = [], self._model.opt.timestep
        for i, (grip, gain) in enumerate(zip(self._grip, self._gain_now, strict=True)):
            if not gain:  # what turns this rotor is the tyre
                efforts.append(0.0)
                continue
            turned, hastened = angle[i] - self.angle[i], rate[i] - self.rate[i]
            # Euler's method pushes by the rates before each of its steps, and moves by those after.
            slower = told[i] - (turned - timestep * hastened) / duration_s
            # What turns the rotor is not for the tyre.
            torque = gain * slower - self._rotor[i] * hastened / duration_s
            efforts.append(min(MOST_EFFORT, max(-MOST_EFFORT, torque / grip)))
        return efforts

    def _set_motors(self, driven: list[bool]) -> None:
        """Which of them hold their wheels."""
        gain = self._gain * driven
        self._gain_now = gain.tolist()
        self._model.actuator_gainprm[self._motor, 0] = gain
        self._model.actuator_biasprm[self._motor, 2] = -gain
        self._driven = driven

    def _set_lock(self, wheel: int, *, locked: bool) -> None:
        """Jam a wheel where it stands, or let it go."""
        data, lock = self._data, self._lock[wheel]
        if locked:
            self._model.eq_data[lock, 0] = data.qpos[self._roll_position[wheel]]
            data.qvel[self._roll_velocity[wheel]] = 0.0
        data.eq_active[lock] = locked
        self._held[wheel] = locked


def _xml(drive: Drive, radii: Floats, heading: list[float], build: Build) -> str:
    """The robot in MuJoCo's language."""
    n, mass = drive.n, drive.n * MASS_KG
    wheel_mass = WHEEL_SHARE * MASS_KG
    # A soft contact lets a wheel sink and so makes it smaller: these contacts cost 0.3 % of radius.
    # Stiffer ones, or heavier wheels, make sliding wheels hop.
    # Wheels count for the whole, which has the same moment of inertia as the fast body.
    chassis_mass = mass - n * wheel_mass
    size = float(np.sum(drive.xy**2)) * wheel_mass
    moment = mass * (build.gyration * drive.length_m) ** 2 - size
    moment = max(moment, 0.1 * mass * drive.length_m**2)
    load = MASS_KG * GRAVITY
    stiffness, damping = load / SPRING_M, 2.0 * math.sqrt(load / SPRING_M * wheel_mass)
    wheels, motors, locks = [], [], []
    for i, ((x, y), radius) in enumerate(zip(drive.xy.tolist(), radii.tolist(), strict=True)):
        joint = f'<joint name="steer{i}" axis="0 0 1" armature="0.01"/>' if drive.steers[i] else ""
        start = "" if drive.steers[i] else f' euler="0 0 {heading[i]}"'
        inertia = 0.5 * wheel_mass * radius**2
        has_motor = drive.wheels[i].radius_m is not None
        rotor = ROTOR_SHARE * MASS_KG * radius**2 if has_motor else 0.0
        wheels.append(
            f"""
      <body pos="{x} {y} {radius}"{start}>
        <joint type="slide" axis="0 0 1" stiffness="{stiffness}" damping="{damping}"
               springref="{-SPRING_M}"/>
        {joint}
        <inertial pos="0 0 0" mass="{wheel_mass / 2}" diaginertia="{inertia} {inertia} {inertia}"/>
        <body>
          <joint name="roll{i}" axis="0 1 0" armature="{rotor}"/>
          <inertial pos="0 0 0" mass="{wheel_mass / 2}"
                    diaginertia="{inertia} {2 * inertia} {inertia}"/>
          <geom name="wheel{i}" type="ellipsoid" size="{radius} {radius / 4} {radius}"
                priority="1" friction="{build.friction} 0 0" solref="0.01 1"
                solimp="0.95 0.99 0.0005"/>
        </body>
      </body>"""
        )
        most = MOST_EFFORT * build.friction * load * radius
        motors.append(
            f'<general name="motor{i}" joint="roll{i}" biastype="affine" '
            f'forcerange="{-most} {most}"/>'
        )
        if drive.steers[i]:
            motors.append(f'<position name="steering{i}" joint="steer{i}" kp="100" kv="2"/>')
        locks.append(
            f'<joint name="lock{i}" joint1="roll{i}" active="false" solref="0.004 1" '
            'solimp="0.99 0.999 0.001"/>'
        )
    return f"""
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{STEP_S}" integrator="Euler" cone="elliptic" impratio="10"
          gravity="0 0 0"/>
  <default><geom contype="1" conaffinity="2"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" contype="2" conaffinity="1"/>
    <body name="chassis" pos="0 0 0">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="heading" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{chassis_mass}" diaginertia="{moment} {moment} {moment}"/>
      {"".join(wheels)}
    </body>
  </worldbody>
  <equality>{"".join(locks)}</equality>
  <actuator>{"".join(motors)}</actuator>
</mujoco>"""
