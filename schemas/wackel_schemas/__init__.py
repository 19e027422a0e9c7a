"""What travels between wackel's processes: message types, keys, fault codes. No I/O.

Every message is a MessagePack map with names (see :mod:`wackel_schemas.wire`), so that any
language reads it without this package; JSON Schemas of all of them lie in ``schemas/json``.
"""
