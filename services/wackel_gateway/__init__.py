"""The gateway: owns one servo bus, passes on every byte with its time, decodes what servos say.

Three ways to own it: :mod:`.poll` (master), :mod:`.proxy` (the user's software is the master and
talks through us) and :mod:`.tap` (listens only). Pure: :mod:`.schedule` with :mod:`.pings` and
:mod:`.slow_reads` (what to ask next), :mod:`.roster` and :mod:`.presence` (whom), :mod:`.patience`
(how long to wait), :mod:`.commands`, :mod:`.decode`, :mod:`.segment`, :mod:`.statistics`. Shells:
:mod:`.port`, :mod:`.exchange`, :mod:`.forward`, :mod:`.management`.
"""
