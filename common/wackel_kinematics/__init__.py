"""Kinematics of wheeled drives: rows, velocities, candidates. Arrays in, arrays out, no I/O.

"The paper" in this package is Rienmüller, Gruber, Hofbaur: "Odometriebasierte Fehlerdiagnose für
quasiomnidirektionale mobile Radroboter"; equations are cited by its numbers. Robot frame: x
forward, y left, angles counter-clockwise (REP-103). A twist is ξ = [vx, vy, ω] in m/s, m/s, rad/s
(eq. 1), everything in SI units and radians.

Every function takes leading batch axes (``...``), so that one call serves one sample or a whole
recording. The way from wheels to a velocity::

    drive = Drive([steered(Placement(0.3, a), radius_m=0.05) for a in (0.0, 2.1, 4.2)])
    rows, values = drive.rows(steering), drive.values(wheel_rate)
    twist, rank = least_squares(rows, values, drive.length_m)
    candidates = Candidates(drive)
    usable = ~candidates.singularities(drive.rows(commanded_steering)).any
    twists = candidates.twists(rows, values)
"""
