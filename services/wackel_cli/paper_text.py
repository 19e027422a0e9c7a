"""The paper's experiment in words: signatures, verdicts, and where this robot differs."""

from collections.abc import Sequence

from wackel_cli.paper_log import (
    BLOCKED_PHASE_S,
    BLOCKED_S,
    EXPECTED,
    FREE_PHASE_S,
    PaperLog,
    signatures,
    verdicts,
)
from wackel_schemas.residuals import Residuals

_SHOWN = 5  # signatures; the rest are single residuals at the edges of thresholds

_OF_DRIVE = ("wheel", "gyro", "drive", "command")
_LATE = """\
  The computer itself was late in serving the bus meanwhile. Rates come from positions and their
  stamps, so signatures are worse than on a computer that has time."""

_DIFFERENCES = """\
Where this robot differs from the paper's, and why
  - Wheel 3 rolls freely from the start. A wheel that rolls freely is consistent with the others,
    so by itself it shows nothing. The paper's swings about its set point; here that is put in as
    play of the gear, {play:.0%} of the speed at {hertz:g} Hz. Both numbers are assumptions.
  - The paper gives neither dimensions nor masses. Here the wheels stand 0.2 m from the centre and
    have a radius of 0.05 m; friction is that of rubber on a dry floor.
  - How far the sound wheels slow down once wheel 3 is blocked depends on how their velocity control
    yields to load (here 0.06 m/s at the limit of grip) and how the robot is braked depends on the
    friction under the blocked wheel. The directions are the paper's, the amounts are not.
  - The thresholds of Steps II and III were found by experiment in the paper and are not given;
    those here are the diagnoser's own.
"""


def story(log: PaperLog, *, play: float, hertz: float) -> str:
    """All of it.

    Args:
        log: The experiment; with residuals.
        play: Swing of the free wheel, share of its speed.
        hertz: How fast.
    """
    free, blocked = log.between(FREE_PHASE_S), log.between(BLOCKED_PHASE_S)
    names = ", ".join(each.name for each in log.residuals[0][1].candidates)
    lines = [
        "The paper's experiment (section 5), through gateway, bus and diagnoser",
        f"Candidates in the paper's order: {names}",
        "",
        f"Wheel 3 free, {FREE_PHASE_S[0]:g} to {FREE_PHASE_S[1]:g} s "
        f"({len(free)} residuals; the paper: {EXPECTED}, the rate of wheel 3)",
        *_phase(free),
        "",
        f"Wheel 3 blocked at {BLOCKED_S:g} s, {BLOCKED_PHASE_S[0]:g} to {BLOCKED_PHASE_S[1]:g} s "
        f"({len(blocked)} residuals; the paper: Step II names nothing, Step III the rate of "
        "wheel 3)",
        *_phase(blocked),
        "  mean rates by what was wanted: "
        + ", ".join(f"wheel {i + 1} {share:.2f}" for i, share in _shares(log)),
        f"  mean yaw rate by what was wanted: {log.mean_yaw(BLOCKED_PHASE_S):.2f}",
        "",
        "What wackel says",
        *(
            f"  {at:6.2f} s  {report.status}: {report.message}"
            for at, report in log.faults
            if report.component.partition("/")[0] in _OF_DRIVE
        ),
        *([_LATE] if any(report.code == "host_lag" for _, report in log.faults) else []),
        "",
    ]
    return "\n".join(lines) + _DIFFERENCES.format(play=play, hertz=hertz)


def _phase(residuals: Sequence[tuple[float, Residuals]]) -> list[str]:
    if not residuals:
        return ["  the diagnoser has said nothing"]
    lines = [
        f"  {share:6.1%}  signature {signature}"
        for signature, share in signatures(residuals)[:_SHOWN]
    ]
    for step in ("III", "IV"):
        said = list(verdicts(residuals, step).items())[:_SHOWN]
        lines += [f"  {share:6.1%}  Step {step}  {words}" for words, share in said]
    return lines


def _shares(log: PaperLog) -> list[tuple[int, float]]:
    return list(enumerate(log.mean_rates(BLOCKED_PHASE_S).tolist()))
