"""Measurements against the budgets, each beside a peer in the same run (``make bench``)."""
