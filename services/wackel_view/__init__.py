"""Live view of the robot for viewers that speak the Foxglove protocol."""
