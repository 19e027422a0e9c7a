"""Long runs of random and mutated bytes against every parser: ``make fuzz``.

A target (:mod:`tests.fuzz.target`) makes its own bytes from a seeded generator and judges the
parser's answer by means of its own; :mod:`tests.fuzz.__main__` runs the table of targets.
"""
