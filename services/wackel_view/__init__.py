"""Live view of the robot for viewers that speak the Foxglove protocol.

Pure: :mod:`.drawing` (poses, colours), :mod:`.robot_scene` (body, wheels, path),
:mod:`.velocity_scene` (the candidates), :mod:`.health_text`, and :mod:`.core`, which turns messages
into drawings. :mod:`.layout`: the prepared arrangement. Shell: :mod:`.service`.
"""
