"""Wire protocols of servo buses, one package or module for each: bytes in, values out, no I/O."""
