"""A gyro of the robot computer (Linux IIO), published on ``imu/<name>``."""
