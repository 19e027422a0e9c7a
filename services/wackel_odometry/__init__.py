"""Odometry: pose and twist from wheels and gyro, and what each of them is worth.

The filter (``core``) takes stamped samples and gives a state with covariances; the modules beside
it make those samples from topics, watch the gyro, and find a drive's calibration from recorded
runs whose true path is known. Nothing here has a clock: time is the stamps of the messages.
"""
