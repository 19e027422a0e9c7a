"""What the diagnoser sees: the paper's Steps I to IV, and the likelihoods that decide.

"The paper" is Rienmüller, Gruber, Hofbaur: "Odometriebasierte Fehlerdiagnose für
quasiomnidirektionale mobile Radroboter". SI units and radians.
"""

from wackel_schemas.message import Message, Record


class Candidate(Record, kw_only=True):
    """The robot's velocity by the slide rows of two wheels and the roll row of one (eq. 9).

    Attributes:
        name: The paper's, with wheels counted from 1: ``(1,2;1)``.
        vx, vy, omega: m/s, m/s, rad/s; absent where the three rows determine none.
        singular: Step I leaves it out: at the commanded steering the centre of rotation lies at
            the contact (A) or the axles coincide (B); empty: neither.
        deviates: Step II: it misses the command. Never for one that is left out.
    """

    name: str
    vx: float | None = None
    vy: float | None = None
    omega: float | None = None
    singular: str = ""
    deviates: bool = False


class PaperStep(Record, kw_only=True):
    """The verdict of one of the paper's steps.

    Attributes:
        step: ``I`` to ``IV``.
        text: In words.
        components: What it names, if it names anything.
    """

    step: str
    text: str
    components: list[str] = []


class Redundancy(Record, kw_only=True):
    """Step III: whether the candidates fall in two without a component (eq. 12).

    Attributes:
        component: Which would be faulty.
        agree: All candidates that do not use it agree with each other, and there are several.
        apart: All that do use it miss each of those.
    """

    component: str
    agree: bool
    apart: bool


class RowState(Record, kw_only=True):
    """One measurement against what all together say.

    Attributes:
        name: ``wheel/<name>/slide`` and ``…/roll`` (m/s), ``gyro/<name>`` (rad/s),
            ``wheel/<name>/steering`` (rad) and ``…/rolling`` (m/s) against the references.
        residual: How far it is off.
        sigma: Standard deviation that this has without a fault.
        scale: By what factor fault-free driving has shown sigma to be larger than assumed.
    """

    name: str
    residual: float
    sigma: float
    scale: float


class HypothesisState(Record, kw_only=True):
    """One explanation.

    Attributes:
        components: What would be faulty; none: nothing is.
        fault: ``sensor``, ``actuator``, or empty where that is not asked.
        probability: Among all explanations, as the last fractions of a second tell.
    """

    components: list[str] = []
    fault: str = ""
    probability: float = 0.0


class Residuals(Message, kw_only=True):
    """What the diagnoser sees (``residuals``), some times a second; the stamp is that of a step.

    Attributes:
        commanded: The commanded twist [vx, vy, omega]; absent: none is known.
        candidates: In the paper's order.
        signature: Step II, a bit for each candidate that Step I leaves: ``000101``.
        redundancy: Step III's conditions, of each component, once Step II sees something.
        steps: The paper's verdicts.
        rows: The measurements.
        hypotheses: The likeliest, first the best.
        alarm: The largest cumulative sum as a share of the threshold; at 1 there is an alarm.
        verdict: Components that are taken to be faulty.
        lags_s: Time constants of steering and rolling, as learnt from driving.
    """

    commanded: list[float] | None = None
    candidates: list[Candidate] = []
    signature: str = ""
    redundancy: list[Redundancy] = []
    steps: list[PaperStep] = []
    rows: list[RowState] = []
    hypotheses: list[HypothesisState] = []
    alarm: float = 0.0
    verdict: list[str] = []
    lags_s: list[float] = []
