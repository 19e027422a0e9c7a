"""The wire of Dynamixel Protocol 2.0, both directions, without I/O and without clocks.

========================  =======================================================================
:mod:`.packet`            packets, their bytes, a builder for each instruction, ``decode``
:mod:`.stuffing`          the extra FD after FF FF FD
:mod:`.scanner`           any byte stream into valid, damaged, zero and stray segments
:mod:`.expectation`       which answers an instruction calls for
:mod:`.answers`           the answers to one instruction, fast when all is well
:mod:`.fast`              answers of fast sync read and fast bulk read, with their chain of CRCs
:mod:`.errors`            error byte and Hardware Error Status in words
:mod:`.control_table`     models, registers, units
:mod:`.tables`            the data behind it
========================  =======================================================================
"""

from wackel_protocols.dynamixel2.answers import AnswerReader, Answers, Status, reader
from wackel_protocols.dynamixel2.control_table import Model, Register, UnknownModel, model
from wackel_protocols.dynamixel2.expectation import Expectation, expect
from wackel_protocols.dynamixel2.packet import (
    BROADCAST_ID,
    HEADER,
    MAX_ID,
    Instruction,
    InstructionPacket,
    PacketError,
    StatusPacket,
    action,
    bulk_read,
    bulk_write,
    clear,
    control_table_backup,
    decode,
    factory_reset,
    fast_bulk_read,
    fast_sync_read,
    ping,
    read,
    reboot,
    reg_write,
    sync_read,
    sync_write,
    write,
)
from wackel_protocols.dynamixel2.scanner import Kind, Scanner, Segment, scan
from wackel_protocols.dynamixel2.tables import Series

__all__ = [
    "BROADCAST_ID",
    "HEADER",
    "MAX_ID",
    "AnswerReader",
    "Answers",
    "Expectation",
    "Instruction",
    "InstructionPacket",
    "Kind",
    "Model",
    "PacketError",
    "Register",
    "Scanner",
    "Segment",
    "Series",
    "Status",
    "StatusPacket",
    "UnknownModel",
    "action",
    "bulk_read",
    "bulk_write",
    "clear",
    "control_table_backup",
    "decode",
    "expect",
    "factory_reset",
    "fast_bulk_read",
    "fast_sync_read",
    "model",
    "ping",
    "read",
    "reader",
    "reboot",
    "reg_write",
    "scan",
    "sync_read",
    "sync_write",
    "write",
]
