"""Drive faults from kinematic residuals: which wheel, steering or sensor lies.

Two layers. The visible one applies the four steps of the paper (``steps``): Rienmüller, Gruber,
Hofbaur, "Odometriebasierte Fehlerdiagnose für quasiomnidirektionale mobile Radroboter". The one
that decides holds every measurement against all others and against what the command asks for
(``reference``, ``rows``), under every hypothesis at once (``hypotheses``, ``bank``), with variances
that fault-free driving scales (``scaling``), and speaks up at a designed rate of false alarms
(``sequential``). Nothing here has a clock: time is the stamps of the messages.
"""
