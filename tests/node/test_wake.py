"""Waking a thread that waits."""

import math
import signal
import threading
import time

from wackel_node.wake import Wake

LIMIT_S = 30.0


def ends(work: threading.Thread) -> bool:
    work.start()
    work.join(LIMIT_S)
    return not work.is_alive()


def test_words_that_are_there_are_taken_at_once_and_one_that_is_true_counts() -> None:
    wake = Wake()
    assert wake.wait(0.0) is None
    wake.put(False)
    assert wake
    assert wake.wait(math.nextafter(0.0, 1.0)) is False
    assert not wake
    wake.put(True)
    wake.put(False)
    assert wake.wait(LIMIT_S) is True
    assert wake.wait(-1.0) is None


def test_the_shortest_wait_ends() -> None:
    """Its time may be over before it has begun to wait."""

    def wait() -> None:
        for number in range(20_000):
            Wake().wait(number % 30 * 1e-6)

    assert ends(threading.Thread(target=wait, daemon=True))


def test_no_word_is_lost_between_threads() -> None:
    ping, pong = Wake(), Wake()

    def heard(wake: Wake) -> bool:
        """A wait may end early."""
        limit = time.monotonic() + LIMIT_S
        while wake.wait(LIMIT_S) is None:
            if time.monotonic() > limit:
                return False
        return True

    def answer() -> None:
        while heard(ping):
            pong.put(True)

    threading.Thread(target=answer, daemon=True).start()
    for _ in range(5000):
        ping.put(True)
        assert heard(pong)


def test_words_of_many_threads_arrive() -> None:
    wake, count, each = Wake(), 8, 500
    said: list[int] = []

    def say() -> None:
        for _ in range(each):
            said.append(1)
            wake.put(False)

    threads = [threading.Thread(target=say) for _ in range(count)]
    for thread in threads:
        thread.start()
    seen, limit = 0, time.monotonic() + LIMIT_S
    while seen < count * each:
        assert time.monotonic() < limit
        if wake.wait(LIMIT_S) is not None:
            seen = len(said)
    for thread in threads:
        thread.join()


def test_a_signal_handler_wakes_the_thread_that_it_interrupts() -> None:
    wake = Wake()
    previous = signal.signal(signal.SIGALRM, lambda *_: wake.put(True))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        begin = time.monotonic()
        assert wake.wait(LIMIT_S) is True
        assert time.monotonic() - begin < LIMIT_S
    finally:
        signal.signal(signal.SIGALRM, previous)
