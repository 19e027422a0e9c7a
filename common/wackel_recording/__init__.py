"""Recordings: MCAP files of a robot's topics, written to survive a crash, read whatever is left.

One session of recording is one or several files. Each carries, as a metadata record named
``wackel``, whose it is and with which configuration (:mod:`wackel_recording.about`).
"""
