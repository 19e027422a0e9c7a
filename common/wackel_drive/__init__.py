"""The drive as configured: its kinematics, and its sensors aligned in time. No I/O, no clock."""
