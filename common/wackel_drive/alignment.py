"""Samples of all servos and gyros, each with its own stamp, to steps that share begin and end.

A step ends at a sample of the first wheel that is heard of, once every other sensor covers that
time, or has been waited for in vain. What comes late, twice, out of order, from the future or not
at all has a defined and counted outcome; none of it stops the steps.
"""

import math
from collections import Counter
from collections.abc import Mapping
from typing import Literal, TypeAlias

import msgspec

from wackel_drive.layout import Joint, Layout
from wackel_drive.track import Arrival, Track
from wackel_node.config_drive import GyroConfig
from wackel_schemas import component
from wackel_schemas.bus import BusState
from wackel_schemas.drive import ImuSample

Refusal: TypeAlias = Arrival | Literal["implausible", "ahead", "uncertain", "asked_again"]

WAIT_NS = 30_000_000
"""How far the wheels' samples go on before a sensor has been waited for in vain: three cycles at
100 Hz, so that an answer that was lost once is made up for by the next."""
SHORTEST_NS = 7_000_000
"""Steps are no shorter. Rates are differences of positions that encoders round: half a step each
(0.8 mrad of 4096 a turn) is 11 mm/s on a wheel of 5 cm in 7 ms, and twice that in half the time,
while what drives and steerings do takes 15 ms and more. Each reading ends one step and begins the
next, so shorter steps tell nothing more, and each costs as much. States at 100 Hz and 125 Hz end a
step each, even with a jitter of 3 ms and 1 ms; those at 200 Hz every other."""
UNCERTAIN_S = 0.002
"""By how much the time of a sample may be another than its stamp: a fifth of a step at 100 Hz, so
that all speeds seem a fifth too high in one step, and too low in the next."""
AHEAD_NS = 1_000_000_000
"""Stamps further ahead of the steps are not believed at once: they follow a gap, a step of the
clock, or nonsense."""
TO_RESTART = 5
"""Ever newer stamps of states in a row that are such, or of the past, after which they are
believed."""
MOST_ANGLE = 1e8
"""rad; a counter of 32 bit with 4096 steps a turn ends at 3.3e6."""
MOST_RATE = 1e3
"""rad/s, of a wheel or a body; ten times what the fastest servo does."""

_AXES = {"x": 0, "y": 1, "z": 2}


class Step(msgspec.Struct, frozen=True, gc=False):
    """What all sensors said of one stretch of time; NaN where one said nothing.

    Single numbers: for some wheels, Python is faster with them than numpy.

    Attributes:
        begin, end: Stamps, UTC ns.
        seconds: From one to the other.
        heading: Direction of each wheel in the middle of the step, rad to the left of forward;
            only steered wheels have one.
        steered: How far each wheel was steered meanwhile, rad.
        wheel_rate: Mean rolling rate of each wheel, rad/s.
        gyro_rate: Mean rate of each gyro, about the robot's z axis, rad/s.
    """

    begin: int
    end: int
    seconds: float
    heading: list[float]
    steered: list[float]
    wheel_rate: list[float]
    gyro_rate: list[float]


class _Gyro:
    """A gyro as it is mounted.

    Attributes:
        source: Its name in complaints.
        track: What it said.
        axis: Which of the sensor's axes is along the robot's z axis.
        sign: -1 if it points down, else 1.
    """

    __slots__ = ("axis", "sign", "source", "track")

    def __init__(self, name: str, config: GyroConfig) -> None:
        self.source = component.gyro(name)
        self.track = Track()
        self.axis = _AXES[config.axis[-1]]
        self.sign = -1.0 if config.axis.startswith("-") else 1.0


class Alignment:
    """Aligns the servos of a drive and its gyros.

    Attributes:
        counts: What was not taken as it came, by source and reason.
        refused: Source and reason of what has not been taken; the owner clears it.
        restarts: How often time was started anew.
        newest: Newest stamp that was taken from any sensor; ``None`` before the first.
    """

    def __init__(self, layout: Layout, gyros: Mapping[str, GyroConfig]) -> None:
        self.counts: Counter[tuple[str, Refusal]] = Counter()
        self.refused: list[tuple[str, Refusal]] = []
        self.restarts = 0
        self.newest: int | None = None
        self._n = len(layout.names)
        self._by_bus: dict[str, dict[int, Track]] = {}
        # By number of the wheel. Signs are floats, with which Python multiplies faster.
        self._rolling = [
            (i, float(joint.sign), self._track(joint))
            for i, joint in enumerate(layout.rolling)
            if joint is not None
        ]
        self._steering = [
            (i, float(joint.sign), joint.offset, self._track(joint))
            for i, joint in enumerate(layout.steering)
            if joint is not None
        ]
        self._gyros = {name: _Gyro(name, config) for name, config in gyros.items()}
        servos = (track for tracks in self._by_bus.values() for track in tracks.values())
        # Gyros first: mostly it is them that a step waits for.
        self._tracks = (*(gyro.track for gyro in self._gyros.values()), *servos)
        self._done: int | None = None
        self._wheels_newest = 0
        self._strange = 0  # stamps of states in a row that do not fit, each newer than all before
        self._strange_newest = 0

    @property
    def done(self) -> int | None:
        """Up to where steps have been made, UTC ns; ``None`` before the first state."""
        return self._done

    def bus_state(self, bus: str, state: BusState) -> bool:
        """Takes in what the servos of a bus said; what is not of the drive is ignored, and so is
        the speed of a servo that says its position in states of their own.

        Returns:
            Whether any of it was taken; else no step can have become due.
        """
        tracks = self._by_bus.get(bus)
        if tracks is None:
            return False
        stamp, believed, taken, done = state.stamp, False, False, 0
        for servo in state.servos:
            track = tracks.get(servo.id)
            if track is None:
                continue
            position, velocity = servo.position, servo.velocity
            if position is None and (velocity is None or track.shows_angle(stamp)):
                continue
            if not believed:
                if state.asked_again:
                    # Between two usual states, one in which each wheel is shown at another time
                    # makes some seem too fast by a tenth, and then too slow. Why they were asked
                    # again, the classifier tells of the bus.
                    self.counts[component.bus(bus), "asked_again"] += 1
                    return False
                if not state.late_s <= UNCERTAIN_S:  # NaN is not, either
                    self._refuse(component.bus(bus), "uncertain")
                    return False
                if not self._fits(stamp, bus):
                    return False
                believed, done = True, self._done or 0
            # Not so of NaN, which no comparison holds for.
            if not (
                (position is None or abs(position) <= MOST_ANGLE)
                and (velocity is None or abs(velocity) <= MOST_RATE)
            ):
                self._refuse(component.servo(bus, servo.id), "implausible")
                continue
            arrival = track.add(stamp, position, velocity, done)
            if arrival == "kept" or self._taken(component.servo(bus, servo.id), arrival):
                taken = True
        if taken:
            self._wheels_newest = max(self._wheels_newest, stamp)
            self._newer(stamp)
        return taken

    def gyro(self, name: str, sample: ImuSample) -> float | None:
        """Takes in a gyro's sample.

        Returns:
            Its rate about the robot's z axis, rad/s; ``None`` if it was not taken.

        Raises:
            KeyError: No such gyro is configured.
        """
        gyro, stamp, done = self._gyros[name], sample.stamp, self._done
        x, y, z = rates = sample.angular_velocity
        # Not so of NaN, which no comparison holds for.
        if not (abs(x) <= MOST_RATE and abs(y) <= MOST_RATE and abs(z) <= MOST_RATE):
            self._refuse(gyro.source, "implausible")
            return None
        if not sample.late_s <= UNCERTAIN_S:  # NaN is not, either
            self._refuse(gyro.source, "uncertain")
            return None
        if done is not None and abs(stamp - done) > AHEAD_NS:
            # Whether the gyro's clock is wrong or the wheels are silent, the next step will tell.
            self.counts[gyro.source, "ahead" if stamp > done else "late"] += 1
            return None
        rate = gyro.sign * rates[gyro.axis]
        arrival = gyro.track.add(stamp, None, rate, done or 0)
        if arrival != "kept" and not self._taken(gyro.source, arrival):
            return None
        self._newer(stamp)
        if done is None:
            # Nothing to hold it against yet; a lone gyro must not fill its track.
            gyro.track.forget(stamp - AHEAD_NS)
        return rate

    def step(self) -> Step | None:
        """The next step, once it is due; call until there is none."""
        begin = self._done
        if begin is None or self._wheels_newest < begin + SHORTEST_NS:
            return None
        end = self._next_end(begin)
        if end is None or not self._covered(end):
            return None
        seconds = (end - begin) / 1e9
        nothing = [math.nan] * self._n
        heading, steered, wheel_rate = nothing, nothing.copy(), nothing.copy()
        for i, sign, offset, track in self._steering:
            angle, turned = track.pass_by(begin, end)
            if turned is not None and angle is not None:
                heading[i] = sign * (angle + turned / 2.0) + offset
                steered[i] = sign * turned
        for i, sign, track in self._rolling:
            turned = track.pass_by(begin, end)[1]
            if turned is not None:
                wheel_rate[i] = sign * turned / seconds
        gyro_rate = []
        for gyro in self._gyros.values():
            turned = gyro.track.pass_by(begin, end)[1]
            gyro_rate.append(math.nan if turned is None else turned / seconds)
        self._done = end
        return Step(begin, end, seconds, heading, steered, wheel_rate, gyro_rate)

    def _track(self, joint: Joint) -> Track:
        """A new one, of a servo's samples."""
        track = self._by_bus.setdefault(joint.servo.bus, {})[joint.servo.id] = Track()
        return track

    def _next_end(self, begin: int) -> int | None:
        """Where the next step ends: at a sample of the first driven wheel that is not absent."""
        for _, _, track in self._rolling:
            if track.newest + WAIT_NS >= self._wheels_newest:
                return track.after(begin + SHORTEST_NS)
        return None

    def _covered(self, end: int) -> bool:
        """Whether nothing is left that waiting for could bring."""
        waited = self._wheels_newest >= end + WAIT_NS
        for track in self._tracks:
            if track.awaited_from < end:
                if not waited:
                    return False
                track.awaited_from = math.inf
        return True

    def _fits(self, stamp: int, bus: str) -> bool:
        """Whether a state's stamp can be believed; starts time anew where enough of them agree."""
        done = self._done
        if done is None:
            self._begin(stamp)
            return True
        if done - AHEAD_NS < stamp <= done + AHEAD_NS:
            self._strange = 0
            return True
        if abs(stamp - self._strange_newest) > AHEAD_NS:
            self._strange, self._strange_newest = 1, stamp
        elif stamp > self._strange_newest:
            # Only then: buses that take turns may tell of the past, and a state may come twice.
            self._strange, self._strange_newest = self._strange + 1, stamp
        if self._strange < TO_RESTART:
            self._refuse(component.bus(bus), "ahead" if stamp > done else "late")
            return False
        self._restart(stamp)
        return True

    def _begin(self, stamp: int) -> None:
        """The first state: from now on there is something to hold the stamps of gyros against."""
        self._done = self.newest = stamp
        for gyro in self._gyros.values():
            if abs(gyro.track.newest - stamp) > AHEAD_NS:
                gyro.track.clear()

    def _newer(self, stamp: int) -> None:
        if self.newest is None or stamp > self.newest:
            self.newest = stamp

    def _taken(self, source: str, arrival: Arrival) -> bool:
        """Counts a sample that did not come as it should; says whether it was taken even so."""
        if arrival == "reordered":
            self.counts[source, arrival] += 1
            return True
        self._refuse(source, arrival)
        return False

    def _refuse(self, source: str, reason: Refusal) -> None:
        self.counts[source, reason] += 1
        self.refused.append((source, reason))

    def _restart(self, stamp: int) -> None:
        self.restarts += 1
        self._strange = 0
        self._done = self._wheels_newest = self.newest = stamp
        for track in self._tracks:
            track.clear()
