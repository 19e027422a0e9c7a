"""Playback: a recording in the gateway's place."""
