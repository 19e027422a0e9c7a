"""How a measurement is shown: the figure, its peer in the same run, the budget, and whether met."""

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from statistics import median
from time import perf_counter_ns, process_time_ns
from typing import Generic, TypeVar

from rich.console import Console
from rich.table import Table

T = TypeVar("T")
_WIDTH = 132  # of tables that go to a file


@dataclass(frozen=True)
class Figure:
    """One measured figure.

    Attributes:
        name: What was measured.
        value: In ``unit``.
        peer: What it is held against, and its figure in the same unit; absent if the budget is
            absolute.
        budget: Largest allowed value/peer, or value; absent if the figure only informs.
        at_least: The budget is a least instead of a largest value.
    """

    name: str
    value: float
    unit: str
    peer: tuple[str, float] | None = None
    budget: float | None = None
    at_least: bool = False

    @property
    def compared(self) -> float:
        """What the budget applies to: the ratio to the peer, or the value."""
        return self.value / self.peer[1] if self.peer else self.value

    @property
    def met(self) -> bool | None:
        """Whether the budget is met; absent without one."""
        if self.budget is None:
            return None
        return self.compared >= self.budget if self.at_least else self.compared <= self.budget


class Prepared(Generic[T]):
    """An action on messages that are made ready before its turn, which is not measured.

    They are as new to the processor's memory as those are that a service has just decoded; what lay
    ready for a whole run would be read from afar, and cost up to a tenth more.

    Args:
        prepare: Makes so many.
        act: What is measured, on one of them.
    """

    def __init__(self, prepare: Callable[[int], Iterable[T]], act: Callable[[T], object]) -> None:
        self._prepare = prepare
        self._act = act
        self._ready: Iterator[T] = iter(())

    def prepare(self, calls: int) -> None:
        """Makes ready what so many calls take."""
        self._ready = iter(list(self._prepare(calls)))

    def __call__(self) -> None:
        """Measured."""
        self._act(next(self._ready))


def console() -> Console:
    """Where tables are printed."""
    return Console(width=None if sys.stdout.isatty() else _WIDTH)


def table(title: str, figures: list[Figure]) -> Table:
    """The figures as people read them."""
    shown = Table(title=title, title_justify="left")
    for heading in ("what", "figure", "peer in the same run", "ratio", "budget", "met"):
        shown.add_column(heading, justify="left" if heading in ("what", "met") else "right")
    for figure in figures:
        sign = "≥" if figure.at_least else "≤"
        shown.add_row(
            figure.name,
            f"{figure.value:.4g} {figure.unit}",
            f"{figure.peer[0]}: {figure.peer[1]:.4g} {figure.unit}" if figure.peer else "",
            f"{figure.compared:.3f}" if figure.peer else "",
            f"{sign} {figure.budget:g}" if figure.budget is not None else "",
            {True: "[green]yes", False: "[red]NO", None: ""}[figure.met],
        )
    return shown


def side_by_side(
    *actions: Callable[[], object], rounds: int = 60, calls: int = 50, cpu: bool = False
) -> list[float]:
    """Median µs a call of each action, measured in turn so that a drift of the machine hits all.

    Args:
        actions: What to measure; see :class:`Prepared`.
        rounds: How often each has its turn.
        calls: Calls a turn.
        cpu: Measure the process's CPU time instead of the wall clock.
    """
    now = process_time_ns if cpu else perf_counter_ns
    samples: list[list[float]] = [[] for _ in actions]
    for _ in range(rounds):
        for action, mine in zip(actions, samples, strict=True):
            if isinstance(action, Prepared):
                action.prepare(calls)
            begin = now()
            for _ in range(calls):
                action()
            mine.append((now() - begin) / calls / 1000)
    return [median(mine) for mine in samples]
