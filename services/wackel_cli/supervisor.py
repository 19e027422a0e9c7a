"""Keeps a set of subcommands running as processes, and leaves none behind."""

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import IO, Literal, Self

from wackel_node.errors import OK, USAGE

FIRST_DELAY_S = 0.2
LONGEST_DELAY_S = 8.0
# Longer than a service needs to fail at what is wrong with its surroundings.
SOUND_LIFE_S = 10.0
# Of the second in which all has to be over, the rest is for SIGKILL and for the supervisor.
GRACE_S = 0.8


@dataclass(frozen=True)
class Job:
    """A process to keep running.

    Attributes:
        name: For people; a service's is ``<service>/<instance>``.
        arguments: Of ``wackel``.
        after: Names of jobs that have to be ready before the first start.
        patience_s: After so long it starts even so.
        once: Whether it is over for good when it ends without an error.
        outlives: Whether it is stopped only after the others, which would take its end for a fault.
    """

    name: str
    arguments: tuple[str, ...]
    after: tuple[str, ...] = ()
    patience_s: float = math.inf
    once: bool = False
    outlives: bool = False


@dataclass(frozen=True)
class Change:
    """What happened to a process.

    Attributes:
        name: Of the job.
        event: ``started``; ``exited`` and to be restarted; ``finished`` what it was for; ``given
            up`` (its configuration is wrong, so that a restart cannot help); ``stopped`` on
            request; ``killed`` because it did not stop.
        pid: Of the process.
        detail: How it ended and when it is restarted, in words.
    """

    name: str
    event: Literal["started", "exited", "finished", "given up", "stopped", "killed"]
    pid: int
    detail: str = ""


@dataclass
class Backoff:
    """How long to wait before a restart: doubling, until a process has lived soundly again."""

    delay_s: float = FIRST_DELAY_S

    def after(self, life_s: float) -> float:
        """The delay, s, after a process that lived so long."""
        if life_s >= SOUND_LIFE_S:
            self.delay_s = FIRST_DELAY_S
        delay_s = self.delay_s
        self.delay_s = min(2 * delay_s, LONGEST_DELAY_S)
        return delay_s


@dataclass
class _Run:
    """A job and its process; while there is none, when it is due (``None``: never again)."""

    job: Job
    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    due_s: float | None = 0.0
    backoff: Backoff = field(default_factory=Backoff)


class Supervisor:
    """Runs jobs. Use with ``with``: leaving it stops all of them within a second.

    The owner calls :meth:`step` when a child has died (SIGCHLD) and after :meth:`wait_s`, and
    :meth:`ready` when it hears that of a job.
    """

    def __init__(
        self,
        jobs: Iterable[Job],
        on_change: Callable[[Change], None],
        output: IO[str] | int | None = None,
    ) -> None:
        """Nothing is started yet.

        Args:
            jobs: What to run.
            on_change: Told of every start and end.
            output: Where stdout and stderr of the processes go; ``None``: to this one's stderr.
        """
        self._runs = [_Run(job) for job in jobs]
        self._ready: set[str] = set()
        self._begun_s = time.monotonic()
        self._on_change = on_change
        self._output = sys.stderr if output is None else output

    def __enter__(self) -> Self:
        self.step()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def pids(self) -> dict[str, int]:
        """Process ids of what is running, by name."""
        return {run.job.name: run.process.pid for run in self._runs if run.process is not None}

    def step(self) -> None:
        """Notices what has died and starts what is due."""
        for run in self._runs:
            if run.process is not None and run.process.poll() is not None:
                self._bury(run, run.process)
            due_s = self._due_s(run)
            if due_s is not None and due_s <= time.monotonic():
                self._start(run)

    def ready(self, name: str) -> None:
        """A job says that it is ready; those that come after it may start."""
        if name not in self._ready:
            self._ready.add(name)
            self.step()

    def wait_s(self) -> float:
        """How long the owner may wait before the next step, unless a child dies."""
        due = [due_s for due_s in map(self._due_s, self._runs) if due_s is not None]
        return max(0.0, min(due) - time.monotonic()) if due else 1.0

    def stop(self) -> None:
        """Stops all: SIGTERM, and SIGKILL for the stubborn."""
        running = [(run, run.process) for run in self._runs if run.process is not None]
        limit = time.monotonic() + GRACE_S
        first = [process for run, process in running if not run.job.outlives]
        for process in first:
            process.terminate()
        if len(first) < len(running):
            for process in first:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, limit - GRACE_S / 2 - time.monotonic()))
            for run, process in running:
                if run.job.outlives:
                    process.terminate()
        changes = []
        for run, process in running:
            try:
                process.wait(max(0.0, limit - time.monotonic()))
                change = Change(run.job.name, "stopped", process.pid, _ending(process.returncode))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                change = Change(run.job.name, "killed", process.pid, "did not stop in time")
            run.process, run.due_s = None, None
            changes.append(change)
        for change in changes:  # now that none is left: the reader of what is told may be gone
            self._on_change(change)

    def _due_s(self, run: _Run) -> float | None:
        if run.process is not None or run.due_s is None:
            return None
        if self._ready.issuperset(run.job.after):
            return run.due_s
        limit_s = self._begun_s + run.job.patience_s
        return None if math.isinf(limit_s) else max(run.due_s, limit_s)

    def _start(self, run: _Run) -> None:
        run.started_s = time.monotonic()
        command = [sys.executable, "-m", "wackel_cli.child", str(os.getpid()), *run.job.arguments]
        try:
            run.process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=self._output,
                stderr=self._output,
                process_group=0,  # Ctrl-C is for the supervisor, which stops the others in order
            )
        except OSError as error:  # out of memory or of processes, for now
            self._delay(run, 0, str(error))
        else:
            self._on_change(Change(run.job.name, "started", run.process.pid))

    def _bury(self, run: _Run, process: subprocess.Popen[bytes]) -> None:
        run.process = None
        ending = _ending(process.returncode)
        if process.returncode == OK and run.job.once:
            run.due_s = None
            self._on_change(Change(run.job.name, "finished", process.pid))
        elif process.returncode == USAGE:
            run.due_s = None
            self._on_change(Change(run.job.name, "given up", process.pid, ending))
        else:
            self._delay(run, process.pid, ending)

    def _delay(self, run: _Run, pid: int, ending: str) -> None:
        now_s = time.monotonic()
        delay_s = run.backoff.after(now_s - run.started_s)
        run.due_s = now_s + delay_s
        detail = f"{ending}, restarting in {delay_s:g} s"
        self._on_change(Change(run.job.name, "exited", pid, detail))


def _ending(code: int) -> str:
    if code < 0:
        return f"signal {-code}"
    return "wrong usage or configuration" if code == USAGE else f"exit code {code}"
