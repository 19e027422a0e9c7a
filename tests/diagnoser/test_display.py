"""What people are shown of a simulated robot with a fault."""

from tests.diagnoser.rig import Rig


def test_residuals_say_what_is_seen(warm: Rig) -> None:
    rig = warm.copy()
    rig.inject("wheel_blocked", "w3")
    rig.drive(1.0)
    residuals = rig.residuals
    assert residuals is not None
    assert residuals.verdict == ["wheel/w3/drive"]
    assert residuals.hypotheses[0].components == ["wheel/w3/drive"]
    assert len(residuals.candidates) == 12
    assert {step.step for step in residuals.steps} >= {"I", "II"}
    assert {row.name for row in residuals.rows} >= {"wheel/w3/roll", "gyro/body"}
    assert residuals.lags_s[0] > 0
