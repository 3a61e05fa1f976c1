"""CRC-32, with the results of `zlib`, computed by ISA-L.

It takes a sixteenth of the time of `zlib` (benchmarks/LOG.md), and each chunk is checked three
times on its way into the replay.
"""

from isal.isal_zlib import crc32

__all__ = ["crc32"]
