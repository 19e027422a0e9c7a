"""Drives the robot along a path: commanded twists, and the servo goals that follow from them.

``path``: where to go. ``control``: from a twist to goals. ``wheel_mode``: servos that are ready
to drive. ``hearing``: whether the robot is still there. ``service``: the process.
"""
