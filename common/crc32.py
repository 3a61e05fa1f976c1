"""CRC-32 as `zlib` has it, by ISA-L in a sixteenth of the time (benchmarks/LOG.md): each chunk is
checked three times on its way into the replay."""

from isal.isal_zlib import crc32

__all__ = ["crc32"]
