"""An adapter that stalls: answers of all servos come late though the host is awake.

A USB hub that serves others, a cable with errors, or a driver holds them back, and with them the
instructions. What is asked meanwhile seems lost, but no cable was open.
"""

from wackel_classifier.findings import Finding
from wackel_classifier.lags import LATE_NS, Lags
from wackel_protocols.dynamixel2.packet import STATUS_BYTES
from wackel_schemas import component
from wackel_schemas.bus import Transaction

HELD_NS = 1_000_000
"""Later than usual by a frame of full-speed USB: who answers now and was silent just before had
been held back, too. One in some hundred answers is as late beside other load."""
EXCUSED_NS = 300_000_000
"""So long after a stall that cost a cycle, all who were silent are excused: those that seem to be
gone are asked one by one, every tenth of a second."""
APART_NS = 200_000_000
"""From one stall to the next: a bus that has become slower is late until that is usual, which takes
a dozen answers."""


class AdapterLag:
    """Follows it on one bus.

    Args:
        bus: Its name.
    """

    def __init__(self, bus: str) -> None:
        what = "the host was awake, but answers were held back for"
        self._lags = Lags("adapter_lag", component.adapter(bus), 0.8, what)
        self._silent_ns: int | None = None  # since when nothing at all has come
        self._held_ns = -APART_NS
        self._excuses_until_ns = -1

    def late(self, transaction: Transaction, now_ns: int, *, incomplete: bool) -> None:
        """All answers came as they should, but later than usual by at least :data:`HELD_NS`.

        Args:
            transaction: In which they did.
            now_ns: Classifier's time.
            incomplete: Whether an answer was missing in the one before.
        """
        if not incomplete:
            self._silent_ns = None
        lag_ns = _all_late_ns(transaction)
        if lag_ns >= HELD_NS and self._silent_ns is not None:
            lag_ns = now_ns - self._silent_ns  # it stalls since then, and has lost the rest
        self._held(lag_ns, now_ns, transaction.stamp)

    def look(
        self,
        transaction: Transaction,
        data: bytes,
        now_ns: int,
        *,
        late: bool,
        incomplete: bool,
        present: bool,
    ) -> None:
        """At a transaction that is not as it should be, or that somebody waits for.

        Args:
            transaction: It.
            data: What came.
            now_ns: Classifier's time.
            late: Whether there are answers to earlier requests among it.
            incomplete: Whether an answer was missing in the one before.
            present: Whether anyone was asked who is not known to be gone.
        """
        if not incomplete:
            self._silent_ns = None
        # Answers that collided when all went on are no packets.
        wrecks = not transaction.instruction and len(data) >= STATUS_BYTES
        lag_ns = _all_late_ns(transaction) if data else 0
        tardy = lag_ns >= HELD_NS
        if self._silent_ns is not None and (late or wrecks or tardy):
            self._held(now_ns - self._silent_ns, now_ns, transaction.stamp)
        elif late or tardy:  # what has not come, it has lost
            self._held(max(lag_ns, HELD_NS), now_ns, transaction.stamp)
        if data:
            self._silent_ns = None
        elif self._silent_ns is None and present:
            self._silent_ns = now_ns

    def _held(self, lag_ns: int, now_ns: int, stamp: int) -> None:
        """What came had been held back for so long."""
        if lag_ns < HELD_NS:
            return
        if now_ns - self._held_ns >= APART_NS:
            self._lags.add(lag_ns, now_ns, stamp)
        self._held_ns = now_ns
        until_ns = now_ns + EXCUSED_NS if lag_ns >= LATE_NS else now_ns
        self._excuses_until_ns = max(self._excuses_until_ns, until_ns)

    @property
    def stalls(self) -> int:
        """How many of late have cost a cycle."""
        return len(self._lags)

    def excuses(self, now_ns: int) -> bool:
        """Whether what has been missed until now was held back, too."""
        return now_ns <= self._excuses_until_ns

    def findings(self, now_ns: int) -> list[Finding]:
        """Whether it stalls so often that control suffers."""
        return self._lags.findings(now_ns)


def _all_late_ns(transaction: Transaction) -> int:
    """By how much all that came was later than usual; where the first of it was not, a servo among
    others is slow."""
    return min(transaction.late_ns, transaction.chunks[0].at_ns - transaction.sent_ns)
