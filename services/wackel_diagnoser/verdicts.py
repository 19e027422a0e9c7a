"""Which verdict holds: proposed, taken, replaced by a later one, healed; and what kind it is.

Residuals propose (:mod:`wackel_diagnoser.sequential`), and where they see nothing or another part,
a change of what is constant (:mod:`wackel_diagnoser.small_faults`), which then stays as long as the
change. A proposal that only clears a part that was named must wait until that part has shown itself
sound. A gyro that seems wrong while the motors strain is not: something pushes the robot, or wheels
pull each other. Nor is a part faulty that only seems so since a wheel rolls freely. Wheels that
stand though they are told to roll (:mod:`wackel_diagnoser.standing`) are faulty whatever residuals
say, which then speak of how the others are dragged.
"""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import compress

import numpy as np

from wackel_diagnoser.hypotheses import Class, Hypotheses
from wackel_diagnoser.kinds import WINDOW_S, KindTest
from wackel_diagnoser.reference import Target
from wackel_diagnoser.references import ReferenceErrors
from wackel_diagnoser.rows import Measured, Rows
from wackel_diagnoser.sequential import LEAD, Sequential
from wackel_diagnoser.small_faults import Change, SmallFaults
from wackel_diagnoser.soundness import Soundness
from wackel_diagnoser.standing import Standing
from wackel_drive.alignment import Step
from wackel_drive.layout import Layout
from wackel_kinematics.array import Floats
from wackel_kinematics.drive import Drive
from wackel_schemas import component

SOUND_S = 1.0
"""For how long a part must have shown itself sound before it is healed."""
UNSTUCK_S = 3.0
"""The same of a wheel that stood: one that sticks now and then rolls well in between."""
PUSHED_S = 0.4
"""The same of what pushed the robot: it has let go, and there is nothing that may come loose again;
with the alarm that takes the verdict back, half a second."""
PUSHES_NS = 500_000_000
"""For how long something pushes: what was a fault of a part for longer was no push."""
SLIPS_NS = 2_000_000_000
"""For how long a wheel may slip where nothing but the gyro shows it, as with two wheels: tyres slip
more often than gyros fail; of those that do, most stay wrong."""
DRAGGED_S = 1.0
"""How long an alarm must last to name a second wheel that rolls as it is told: what a faulty one
makes the others slip changes with the motion, within a second."""
HOLDS = 0.05
"""Share by which a motor may be wrong while its wheel yields to the others as is assumed; where it
is more the tyre skids, as if its sensor were wrong."""
CONVICTS = 0.5
"""But a motor may be convicted up to here, since what skids would speak for its sensor."""
ALARM_STEPS = 4
"""How long an alarm takes at least."""
STRAINED = 4.0
"""Mean of what the motors need beyond driving, as squares by what that usually is, while something
pushes the robot: it loads wheels until they slip, and a gyro that is wrong loads none."""
SUDDEN_S = 0.25
"""Within which what pushes the robot shows, from the first evidence: it takes some steps."""
PULLED = 2.0
"""The same mean while wheels of wrong calibration pull each other until some skid: the robot turns
otherwise than they show, by little, so that it takes longer to see than a push."""
FORCED_STEPS = 5
"""That are compared at once with how wheels force each other."""


class Verdicts:
    """Follows them.

    Args:
        layout: The drive.
        hypotheses: What a verdict may be.
        rows: How measurements are numbered.
        sequential: What residuals propose.
        small: What changes of constants propose.
        references: How well it is known how wheels force each other.

    Attributes:
        since: Stamp of the first evidence for each part that is named.
        kinds: Sensor or actuator, of each component; empty where it cannot be told.
        tests: What tells it; none where it cannot be asked.
        steers_wrong: Whether a steering is named, which is then not where it is told to be.
    """

    def __init__(
        self,
        layout: Layout,
        hypotheses: Hypotheses,
        rows: Rows,
        *,
        sequential: Sequential,
        small: SmallFaults,
        references: ReferenceErrors,
    ) -> None:
        self._hypotheses = hypotheses
        self._rows = rows
        self._sequential = sequential
        self._small = small
        self._references = references
        self._rolls = layout.drive.roll_wheels.tolist()
        self._drives = [component.wheel_drive(layout.names[i]) for i in self._rolls]
        self._steerings = {
            component.wheel_drive(name): component.wheel_steering(name) for name in layout.names
        }
        self._spare = _spare(layout.drive, rows)
        self.since: dict[str, int] = {}
        self.kinds: dict[str, Class] = {}
        self.tests: dict[str, KindTest] = {}
        self.steers_wrong = False
        self._free: frozenset[str] = frozenset()
        self._stuck: frozenset[str] = frozenset()
        self._thawed: frozenset[str] = frozenset()  # of the gyros that are named
        self._standing = Standing(len(self._rolls))
        self._of_gyros = {
            number
            for number, names in enumerate(hypotheses.explanations)
            if names and all(name.startswith("gyro/") for name in names)
        }
        self._numbers = {frozenset(names): i for i, names in enumerate(hypotheses.explanations)}
        self._of_command = self._numbers[frozenset((component.COMMAND,))]
        self._is_small = False
        self._began = 0  # stamp of the first evidence for the verdict
        # By what would be left of the verdict: whether the others are sound again.
        self._soundness: dict[int, Soundness] = {}
        self._recent: deque[tuple[Measured, Floats, float]] = deque(maxlen=ALARM_STEPS)
        self._block: list[tuple[Step, Target, Measured, list[float]]] = []

    @property
    def components(self) -> tuple[str, ...]:
        """What is taken to be faulty; none: nothing is."""
        return self._hypotheses.explanations[self._sequential.verdict]

    @property
    def faulty(self) -> list[bool]:
        """At which wheels something is, or pushes, in the order of the roll rows."""
        names = self.components
        pushed = component.DRIVE in names
        return [
            pushed or drive in names or self._steerings[drive] in names for drive in self._drives
        ]

    def stands(self, path: str) -> bool:
        """Whether a part is a drive whose wheel stands while others roll."""
        return any(self._drives[roll] == path for roll in self._standing.rows())

    def free(self, found: Iterable[bool]) -> None:
        """Which wheels are known to roll freely, in the order of the roll rows."""
        free = frozenset(compress(self._drives, found))
        if free != self._free:
            self._free = free
            self._small.forget()  # what was constant no longer is, or is again

    def stuck(self, gyros: Iterable[str]) -> None:
        """These gyros' values, and no others', are stuck from now on; to be told as it changes."""
        stuck = frozenset(map(component.gyro, gyros))
        self._thawed = (self._thawed | self._stuck) - stuck
        self._stuck = stuck
        self._small.forget()

    def void(self) -> None:
        """What was concluded before no longer holds."""
        self._sequential.forget()
        self._sequential.accept(0)
        self._small.forget()
        self.since = {}
        self.tests, self.kinds = {}, {}

    def step(
        self,
        step: Step,
        target: Target,
        measured: Measured,
        efforts: Floats,
        likelihood: Floats,
        *,
        currents: list[float],
    ) -> bool:
        """Takes in a step; says whether the verdict, or its kind, has changed.

        Args:
            step: What the sensors said.
            target: What the wheels should have done.
            measured: The rows of that.
            efforts: Of the motors, see :meth:`Efforts.step`.
            likelihood: Of the hypotheses, logarithms.
            currents: Of the rolling motors, A or share of load; NaN if unknown.
        """
        sequential = self._sequential
        if sequential.verdict:
            self._watch_soundness(step, target, measured, likelihood)
            self._watch_standing(step, target, measured)
        self._recent.append((measured, efforts, step.seconds))
        changed = self._follow(step, target)
        if self.tests:
            changed |= self._tell_kinds(step, target, measured, currents, new=changed)
        return changed

    def _tell_kinds(
        self,
        step: Step,
        target: Target,
        measured: Measured,
        currents: list[float],
        *,
        new: bool,
    ) -> bool:
        """What kinds of faults there are by now; says whether that has changed.

        Args:
            step, target, measured, currents: As above.
            new: Whether the verdict is; an alarm takes some steps, which tell of the kind already.
        """
        recent = list(self._recent) if new else [self._recent[-1]]
        kinds = self.kinds.copy()
        for path, test in self.tests.items():
            if test.seconds >= WINDOW_S:
                continue
            for each in recent:
                test.step(*each)
            if len(self.components) == 1:
                self._force(test, (step, target, measured, currents))
                kinds[path] = self._kind(test)
            else:
                kinds[path] = test.kind()
        changed, self.kinds = kinds != self.kinds, kinds
        return changed

    def _force(self, test: KindTest, moment: tuple[Step, Target, Measured, list[float]]) -> None:
        """Has a steering's test compare how it forces the robot aside."""
        motion = self._references.motion
        if motion is None or not test.steering:
            return
        self._block.append(moment)
        if len(self._block) >= FORCED_STEPS:
            test.force(self._block, self._rows, motion, self._references)
            self._block.clear()

    def _kind(self, test: KindTest) -> Class:
        """Of the only part that is named, also by what has changed of it."""
        kind, small = test.kind(), self._small.found
        if small is not None and self._tells_kind(small):
            return small.kind or (kind if test.clear or not self._is_small else "")
        return kind

    def _follow(self, step: Step, target: Target) -> bool:
        """Takes what is proposed, if it may replace the verdict; says whether it did."""
        sequential, explanations = self._sequential, self._hypotheses.explanations
        if sequential.verdict == self._of_command and not target.known:
            sequential.accept(0)  # there is none any more that would not be followed
            self._take((), step)
            return True
        verdict, small = (
            sequential.verdict,
            None if self._free or self._stuck else self._small.found,
        )
        proposal = sequential.proposal()
        if proposal is None and small is None and not verdict:  # as mostly
            return False
        if proposal in self._of_gyros and self._spare <= 1:
            proposal = self._unless_slipped(proposal, step)
        if proposal in self._of_gyros:
            proposal = self._unless_strained(proposal)
        if self._free:
            proposal = self._unless_free(proposal)
        now = set(explanations[verdict])
        lasting = {small.component} if small is not None else set()
        proposal = self._beside(proposal, frozenset((lasting | self._stuck) & now))
        if self._stuck:
            proposal = self._unless_stuck(proposal)
        is_small = False
        stand = {self._drives[roll] for roll in self._standing.rows()} if verdict else set()
        if stand - now:
            # One that stands seems to be steered wrong, too: it rolls along no direction.
            own = {self._steerings[path] for path in stand}
            others = {path for path in now - own - {component.COMMAND} if not self._follows(path)}
            others |= lasting & now
            standing = self._numbers.get(frozenset(stand | others))
            proposal = proposal if standing is None else standing
        # What a change of constants explains is believed before what fits better for a while. But a
        # wheel that sticks pulls at all others, which looks like many things.
        if (proposal is None or now) and lasting - now and not (stand or self._has_stood()):
            proposal, is_small = self._numbers[frozenset(lasting)], not verdict
        if proposal is None:
            return False
        names = set(explanations[proposal])
        if (lasting & now) - names and not stand & names:
            return False
        if names == {component.DRIVE} and step.end - self._began > PUSHES_NS and now:
            return False
        if names == {component.COMMAND} and self._has_stood():
            return False
        if (stand & now) - names or (names > now and self._are_dragged(names - now)):
            return False
        if names < now and not self._shows_sound(now - names, names):
            return False
        # What pushes a robot that has a faulty wheel looks like a gyro's fault beside it.
        added = _gyros(names - now) - self._stuck
        if now and names > now and added and not self._outlasts_a_push():
            return False
        sequential.accept(proposal)
        self._is_small = is_small
        if not names:
            self._small.forget()
        self._watch(explanations[proposal], now, step, target)
        self._take(explanations[proposal], step)
        return True

    def _unless_slipped(self, proposal: int, step: Step) -> int | None:
        """What a gyro that seems wrong is, as long as a wheel may only slip."""
        sequential, slip = self._sequential, self._numbers[frozenset((component.DRIVE,))]
        if not sequential.verdict:
            return slip
        if sequential.verdict == slip and step.end - self._began < SLIPS_NS:
            sequential.accept(slip)  # which holds already
            return None
        return proposal

    def _unless_strained(self, proposal: int) -> int | None:
        """What gyros that seem wrong are: while motors strain, a push, or nothing of the kind."""
        sequential, push = self._sequential, self._numbers[frozenset((component.DRIVE,))]
        slow = sequential.rising_s > SUDDEN_S
        pushed = sequential.verdict == push
        if self._strain() < (PULLED if slow and not pushed else STRAINED):
            return proposal
        sequential.discredit(proposal)
        if not (slow or pushed):
            return push
        sequential.accept(sequential.verdict)  # it still pushes, or nothing does
        return None

    def _unless_free(self, proposal: int | None) -> int | None:
        """What is proposed, or holds; or wheels that roll freely, if it is what those make seem.

        Which turns as it likes, or is dragged, seems to be steered wrong. Two wheels and a gyro
        check each other, so without one of the wheels nothing tells of any other part; nor does it
        with three omnidirectional ones, and with four nothing tells which part it is.
        """
        sequential, explanations = self._sequential, self._hypotheses.explanations
        free, verdict = self._numbers.get(self._free), sequential.verdict
        named = set(explanations[verdict if proposal is None else proposal])
        seems = named <= {self._steerings[path] for path in self._free}
        seems = seems or self._spare - len(self._free) <= 1
        if free is None or not named or named == self._free or not seems:
            return proposal
        if verdict != free:
            return free
        sequential.accept(free)  # which holds already
        return None

    def _beside(self, proposal: int | None, lasting: frozenset[str]) -> int | None:
        """What is proposed, together with parts that are known to stay wrong, if these alone do not
        explain what is seen; nothing while that may be a push, for which there is no such pair."""
        if not proposal or not lasting:
            return proposal
        both = self._numbers.get(lasting.union(self._hypotheses.explanations[proposal]))
        if both in (None, proposal) or not self._sequential.speaks_for(both):
            return proposal
        return both if self._outlasts_a_push() else None

    def _outlasts_a_push(self) -> bool:
        return 1e9 * self._sequential.alarm_s > PUSHES_NS

    def _unless_stuck(self, proposal: int | None) -> int | None:
        """What is proposed, or holds; or the gyros that are stuck, which explain it."""
        sequential, explanations = self._sequential, self._hypotheses.explanations
        number, verdict = self._numbers.get(self._stuck), sequential.verdict
        named = set(explanations[verdict if proposal is None else proposal])
        if number is None or not named or self._stuck <= named:
            return proposal
        if verdict != number:
            return number
        sequential.accept(number)  # which holds already
        return None

    def _strain(self) -> float:
        """Mean of what the rolling motors need beyond driving, as squares by what that usually is;
        0 if unknown."""
        strains = [efforts[: len(self._rolls)] for _, efforts, _ in self._recent]
        known: list[float] = [s for each in strains for s in each.tolist() if math.isfinite(s)]
        return sum(known) / max(len(known), 1)

    def _tells_kind(self, small: Change) -> bool:
        """Whether what is constant tells a motor from its sensor better than what they cost."""
        most = CONVICTS if small.kind == "actuator" else HOLDS
        here = small.component in self.components and abs(small.size) < most
        return self._is_small or here

    def _take(self, components: Sequence[str], step: Step) -> None:
        """A new verdict."""
        if not components:
            self._standing.begin()
        self._began = step.begin
        self.since = {path: self.since.get(path, step.begin) for path in components}
        # What has been told of a part that stays is still so.
        told = {path: test for path, test in self.tests.items() if test.seconds >= WINDOW_S}
        self.tests = {path: told[path] for path in components if path in told}
        self.kinds = {path: self.kinds[path] for path in self.tests}
        places = [self._hypotheses.place(path) for path in components]
        self.steers_wrong = any(place is not None and place[0] == "steering" for place in places)
        self._block.clear()
        gyros = _gyros(components)
        self._thawed &= gyros
        self.kinds |= dict.fromkeys(gyros, "sensor")
        if gyros:  # which would have to tell of the others
            return
        for path, place in zip(components, places, strict=True):
            if place is not None and path not in self.tests:
                self.tests[path], self.kinds[path] = self._test(path, *place), "sensor"

    def _test(self, path: str, part: str, wheel: int) -> KindTest:
        """Of a component that is named, and which part of which wheel that is."""
        own = self._rolls.index(wheel) if part == "drive" else len(self._rolls) + wheel
        own_rows = self._hypotheses.own_rows(path)
        others = [self._hypotheses.own_rows(other) for other in self.components if other != path]
        others_rows = np.any([np.zeros_like(own_rows), *others], axis=0)
        return KindTest(own_rows, others_rows & ~own_rows, self._rows.gyros, own, len(self._rolls))

    def _are_dragged(self, added: set[str]) -> bool:
        """Whether parts that a proposal adds do what they are told: the named one makes them slip.

        While a wheel stands, it does so all the time; otherwise for a while, or wherever another
        part explains what is seen hardly better.
        """
        lasts = self._sequential.alarm_s >= DRAGGED_S and self._sequential.lead >= LEAD
        lasts = lasts and not self._standing.rows()
        if lasts or "sensor" in self.kinds.values():
            return False
        return all(self._follows(path) or self._is_outskidded(path) for path in added)

    def _follows(self, path: str) -> bool:
        """Whether a part is a drive that rolls as it is told."""
        return path in self._drives and self._standing.follows(self._drives.index(path))

    def _is_outskidded(self, path: str) -> bool:
        """Whether a part is a gyro that only seems wrong: one wheel alone cannot drag others that
        stick, but skids, and nothing else tells of it."""
        left = set(self._drives) - set(self.components)
        return path.startswith("gyro/") and len(left) <= 1

    def _watch_standing(self, step: Step, target: Target, measured: Measured) -> None:
        """Which wheels do what they are told."""
        rolls = self._rows.rolls
        self._standing.step(
            target.speed,
            measured.rolled,
            step.seconds,
            measured.present[rolls].tolist(),
        )

    def _sound_needed_s(self) -> float:
        """For how long what is faulty must look sound to be so."""
        if self.components == (component.DRIVE,):
            return PUSHED_S
        return UNSTUCK_S if self._has_stood() else SOUND_S

    def _has_stood(self) -> bool:
        """Whether any of the drives that are named stood at some time."""
        named = (roll for roll, path in enumerate(self._drives) if path in self.components)
        return any(map(self._standing.stood, named))

    def _watch(
        self, components: Sequence[str], before: set[str], step: Step, target: Target
    ) -> None:
        """Begins to watch whether what is named from now on is sound: all, and each of two."""
        earlier = {
            path: self._soundness[self._numbers[frozenset(before - {path})]]
            for path in components
            if path in before
        }
        rest = [frozenset[str]()]
        if len(components) > 1:
            rest += [frozenset((path,)) for path in components]
        self._soundness = {
            self._numbers[left]: Soundness(
                self._hypotheses,
                self._rows,
                [path for path in components if path not in left],
                step=step,
                target=target,
                earlier=earlier,
            )
            for left in rest
        }

    def _shows_sound(self, cleared: set[str], left: set[str]) -> bool:
        """Whether parts have shown themselves sound, if others stay named.

        Beside a wheel, which may turn the robot by as much as a gyro is off, only a gyro that was
        stuck can.
        """
        if _gyros(cleared) - self._thawed and left - _gyros(left):
            return False
        return self._soundness[self._numbers[frozenset(left)]].lasts(self._sound_needed_s())

    def _watch_soundness(
        self, step: Step, target: Target, measured: Measured, likelihood: Floats
    ) -> None:
        """Which parts of what is named show that nothing is wrong with them."""
        members, item = self._hypotheses.members, likelihood.item
        faulty = max(map(item, members[self._sequential.verdict]))
        for left, soundness in self._soundness.items():
            evidence = faulty - max(map(item, members[left]))
            soundness.step(step, target, measured, evidence)


def _gyros(paths: Iterable[str]) -> set[str]:
    return {path for path in paths if path.startswith("gyro/")}


def _spare(drive: Drive, rows: Rows) -> int:
    """How many more rows tell of the twist than are needed to know it."""
    fixed = ~drive.steers[drive.slide_wheels]
    # The slide rows of wheels that do not steer leave less to know, and tell nothing.
    never = drive.rows(drive.steering(np.zeros(drive.n)))[: drive.slide_count][fixed]
    unknown = 3 - (int(np.linalg.matrix_rank(never)) if len(never) else 0)
    told = len(rows.names[rows.rolls]) + len(rows.names[rows.gyros]) + int((~fixed).sum())
    return told - unknown
