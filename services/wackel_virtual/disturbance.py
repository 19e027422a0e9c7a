"""What disturbs a wire, as random processes: bad contacts, noise, jammers, stray bytes.

All of them draw from a generator that they are given, so the same seed gives the same disturbance.
Numbers without another source are fitted to the thesis, as named beside them.
"""

import math
from random import Random

_EXTREMES = b"\x00\x00\xff"
"""The bytes of a discharge jump between 0 and 255, rarely anything between (thesis, fig. 2.3)."""


def stray_bytes(random: Random, count: int) -> bytes:
    """Bytes of a discharge."""
    return bytes(
        random.choice(_EXTREMES) if random.random() < 0.8 else random.randrange(256)
        for _ in range(count)
    )


def zeros(random: Random) -> bytes:
    """What a receiver makes of a line that has no driver: mostly one 0x00, sometimes a few.

    Source: thesis, 2.5.1; the share of "sometimes" is an assumption.
    """
    return b"\0" * (1 if random.random() < 0.85 else random.randint(2, 4))


class Contact:
    """A loose contact: opens and closes at random, and sparks when it does.

    Sparks are seldom and of any size up to a limit, small ones more often, however fast the contact
    rattles. The numbers are fitted to the thesis's experiment (section 2.5.2: broadcast pings of
    789 ms to three servos, the contact before the third moved by hand): there the total length of
    a message has mean 39 and standard deviation 12, is mostly below 60 and never reaches 100; here,
    at 200 losses per s, 40 and 11.

    Attributes:
        open: Whether the connection is interrupted now.
    """

    OPEN_MEAN_S = 0.006
    OPEN_MAX_S = 0.015
    """A contact that rattles; the supply capacitor of a servo bridges this."""
    BURST_OPEN_MEAN_S = 0.020
    BURST_MEAN_S = 1.0
    BURST_PAUSE_MEAN_S = 2.0
    """A cable that moves with a joint: losses come while it moves, and last longer."""
    SPARK_MAX_BYTES = 28
    SPARK_PAUSE_S = 0.25
    SPARK_WAIT_MEAN_S = 0.9
    """Until the next spark can come: a least time, and a random one beyond."""

    def __init__(self, random: Random, losses_per_s: float, *, bursts: bool) -> None:
        self.open = False
        self._random = random
        self._rate = losses_per_s
        self._bursts = bursts
        share = self.BURST_MEAN_S / (self.BURST_MEAN_S + self.BURST_PAUSE_MEAN_S)
        self._burst_closed_s = max(share / losses_per_s - self.BURST_OPEN_MEAN_S, 0.001)
        self._burst_until_s = 0.0
        self._spark_at_s = 0.0

    def next_toggle_ns(self, at_ns: int) -> int:
        """When it will open or close next."""
        return at_ns + round(self._next_s(at_ns / 1e9) * 1e9)

    def _next_s(self, now_s: float) -> float:
        exponential = self._random.expovariate
        if not self._bursts:
            if self.open:
                return min(exponential(1 / self.OPEN_MEAN_S), self.OPEN_MAX_S)
            return exponential(self._rate)
        if self.open:
            return exponential(1 / self.BURST_OPEN_MEAN_S)
        then_s = now_s + exponential(1 / self._burst_closed_s)
        if then_s > self._burst_until_s:
            then_s = max(now_s, self._burst_until_s) + exponential(1 / self.BURST_PAUSE_MEAN_S)
            self._burst_until_s = then_s + exponential(1 / self.BURST_MEAN_S)
        return then_s - now_s

    def spark(self, at_ns: int) -> bytes:
        """Stray bytes of a change at this time, mostly none."""
        now_s = at_ns / 1e9
        if now_s < self._spark_at_s:
            return b""
        wait_s = self._random.expovariate(1 / self.SPARK_WAIT_MEAN_S)
        self._spark_at_s = now_s + self.SPARK_PAUSE_S + wait_s
        return stray_bytes(self._random, int(self.SPARK_MAX_BYTES ** self._random.random()))


class BitErrors:
    """Noise: each bit is inverted with the same probability, independent of all others.

    The gap to the next error is drawn once for each error, so that clean data costs one comparison.
    """

    def __init__(self, random: Random) -> None:
        self._random = random
        self._rate = 0.0
        self._gap = 0  # clean bits until the next error

    def set_rate(self, rate: float) -> None:
        """Change the bit error rate; 0 is silence."""
        if rate != self._rate:
            self._rate = rate
            self._gap = self._draw() if rate else 0

    def apply(self, data: bytes) -> bytes:
        """``data`` as a receiver gets it."""
        if not self._rate:
            return data
        bits = len(data) * 8
        if self._gap >= bits:
            self._gap -= bits
            return data
        damaged = bytearray(data)
        while self._gap < bits:
            damaged[self._gap >> 3] ^= 1 << (self._gap & 7)
            self._gap += 1 + self._draw()
        self._gap -= bits
        return bytes(damaged)

    def _draw(self) -> int:
        if self._rate >= 1.0:
            return 0
        return int(math.log(1.0 - self._random.random()) / math.log1p(-self._rate))


class JammerStream:
    """What a host reads of a line whose idle level a permanent jammer pulls to 0.8 V.

    Similar chunks over and over: many zeros, small numbers, seldom others (thesis, 2.5.5 and
    fig. 2.5).
    """

    _CHUNK = 44
    """Bytes from one repetition to the next; an assumption, the figure gives no number."""
    _CHUNKS = 96

    def __init__(self, random: Random) -> None:
        first = [self._draw(random) for _ in range(self._CHUNK)]
        ring = bytearray()
        for _ in range(self._CHUNKS):
            # One byte in ten differs from one chunk to the next.
            ring += bytes(self._draw(random) if random.random() < 0.1 else b for b in first)
        self._ring = bytes(ring) * 2
        self._size = len(ring)
        self._position = 0

    @staticmethod
    def _draw(random: Random) -> int:
        kind = random.random()
        if kind < 0.5:
            return 0
        return random.choice((2, 4, 6, 12)) if kind < 0.85 else random.randrange(256)

    def take(self, count: int) -> bytes:
        """The next bytes, at most 4096 at a time."""
        chunk = self._ring[self._position : self._position + count]
        self._position = (self._position + count) % self._size
        return chunk


def jammed_share(quiet_ns: int) -> float:
    """Probability that a permanent jammer destroys a packet for the host.

    Args:
        quiet_ns: Since the host last drove the line.

    The longer the line has been left to the jammer, the worse: 4.8 % of direct pings (0.55 ms with
    the usual Return Delay Time of 500 µs) and 55 % of broadcast pings (3 ms and more) are lost
    (thesis, 2.5.5). The Gaussian between the two is the simplest curve through both.
    """
    return 0.55 * -math.expm1(-((quiet_ns / 1.82e6) ** 2))
