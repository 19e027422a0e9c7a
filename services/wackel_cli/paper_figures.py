"""The content of the paper's figures 5 and 6 as pictures (extra ``sim``: matplotlib)."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from wackel_cli.paper_log import BLOCKED_S, END_S, PaperLog
from wackel_schemas.residuals import Residuals

_OF_WHEEL_3 = "tab:red"
_OTHERS = "tab:blue"
_SIDEWAYS_M_S = 0.5
_TOGETHER = 0.1
"""m/s and rad/s: closer candidates stand at one place of a picture."""
_TICKS = 5
_AXES = ("vx, m/s", "vy, m/s", "ω, rad/s")


def figure_5(log: PaperLog, path: Path) -> None:
    """Candidates against the set point in velocity space while wheel 3 swings."""
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    _velocity_space(axes, log.swinging(), "wheel 3 free: candidates and set point (figure 5)")
    _save(figure, path)


def figure_6(log: PaperLog, path: Path) -> None:
    """Rates of the wheels over time, and the candidates after the block."""
    figure = Figure(figsize=(11.0, 8.0), layout="constrained")
    rates = np.array(log.rates)
    wanted_at = [at for at, _ in log.wanted]
    wanted = np.array([each for _, each in log.wanted])
    for wheel in range(3):
        axes = figure.add_subplot(2, 2, wheel + 1)
        axes.plot(log.times, rates[:, wheel], color=_OTHERS, linewidth=0.8, label="measured")
        axes.plot(wanted_at, wanted[:, wheel], color="black", linewidth=0.8, label="set point")
        axes.axvline(BLOCKED_S, color=_OF_WHEEL_3, linestyle=":")
        axes.set_xlim(0.0, END_S)
        axes.set_title(f"{'abc'[wheel]}) wheel {wheel + 1}")
        axes.set_xlabel("t, s")
        axes.set_ylabel("rad/s")
        axes.grid(visible=True, alpha=0.3)
        axes.legend(loc="upper left")
    axes = figure.add_subplot(2, 2, 4, projection="3d")
    _velocity_space(axes, log.at(49.0), "d) candidates at 49 s")
    _save(figure, path)


def _velocity_space(axes: Any, residuals: Residuals | None, title: str) -> None:
    """Candidates that use the rate of wheel 3 in red, the set point as a cross."""
    axes.set_title(title)
    for set_label, axis, name in zip(
        (axes.set_xlabel, axes.set_ylabel, axes.set_zlabel),
        (axes.xaxis, axes.yaxis, axes.zaxis),
        _AXES,
        strict=True,
    ):
        set_label(name)
        axis.set_major_locator(MaxNLocator(_TICKS))
    if residuals is None:
        return
    # Candidates differ little in vy; alone it would fill its axis.
    axes.set_ylim(-_SIDEWAYS_M_S, _SIDEWAYS_M_S)
    points = {
        candidate.name: (candidate.vx, candidate.vy, candidate.omega)
        for candidate in residuals.candidates
        if None not in (candidate.vx, candidate.vy, candidate.omega) and not candidate.singular
    }
    for uses_it, colour, label in (
        (True, _OF_WHEEL_3, "with the rate of wheel 3"),
        (False, _OTHERS, "without it"),
    ):
        alike = {name: at for name, at in points.items() if name.endswith(";3)") == uses_it}
        if alike:
            axes.scatter(*np.array(list(alike.values())).T, color=colour, label=label)
            # Where they stand together, their names would lie on each other.
            for names, (x, y, z) in _groups(alike):
                axes.text(x, y, z, "  " + "\n  ".join(names), color=colour, va="top", fontsize=8)
    if residuals.commanded is not None:
        axes.scatter(*residuals.commanded, color="black", marker="x", s=60, label="set point")
    axes.legend(loc="upper left", fontsize=8)


def _groups(points: dict[str, Any]) -> list[tuple[list[str], Any]]:
    """Names of those that stand together, and where."""
    groups: list[tuple[list[str], Any]] = []
    for name, at in points.items():
        for names, place in groups:
            if math.dist(at, place) < _TOGETHER:
                names.append(name)
                break
        else:
            groups.append(([name], at))
    return groups


def _save(figure: Figure, path: Path) -> None:
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=120)
