"""The signals that ask a process to end."""

import signal


def stop_signals() -> list[signal.Signals]:
    """SIGINT, SIGTERM and SIGHUP, which comes when the terminal or the connection is closed.

    Without SIGHUP where it is ignored: that is how ``nohup`` keeps a process alive.
    """
    signals = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        signals.append(signal.SIGHUP)
    return signals
