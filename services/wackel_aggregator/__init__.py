"""Merges the faults of all sources, and who is alive, into one health.

``core`` ties the pure parts together: ``faults`` (debounce, healing, inhibition, memory),
``services`` (heartbeats and liveliness) and ``transitions`` (the numbered log). ``store`` keeps
what must outlive a restart; ``service`` is the shell around all of it.
"""
