"""Drives the wheels along a path: commanded twists, and the servo goals that follow from them."""
