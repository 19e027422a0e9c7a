"""A gyro of the robot computer (Linux IIO), published on ``imu/<name>``.

Pure: :mod:`.scan` (what the bytes of a scan mean) and :mod:`.core` (bytes to samples). Shells:
:mod:`.device` (sysfs and the device node) and :mod:`.service`.
"""
