"""The recorder: every topic of the robot into MCAP files."""
