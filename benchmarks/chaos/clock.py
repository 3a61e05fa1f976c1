"""`Clocks`: lets single processes see another time of day than the machine's.

A library that is loaded before the C library adds a number of seconds from a file to the time of
day. Zenoh and TLS therefore see the change too, not only Python. Monotonic clocks do not change,
because no kernel lets them jump.

    python -m benchmarks.chaos.clock LIBRARY FILE MODULE ARGUMENTS
"""

import os
import sys
from pathlib import Path

from benchmarks.child import refusal

_SOURCE = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>

static int (*real)(clockid_t, struct timespec *);
static volatile long *ahead;

__attribute__((constructor)) static void start(void) {
    int file = open(getenv("CHAOS_CLOCK"), O_RDONLY);
    ahead = mmap(0, sizeof *ahead, PROT_READ, MAP_SHARED, file, 0);
    real = dlsym(RTLD_NEXT, "clock_gettime");
}

int clock_gettime(clockid_t id, struct timespec *now) {
    if (!real) start();  /* another library's constructor asks before ours is called */
    int failed = real(id, now);
    if (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE) now->tv_sec += *ahead;
    return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    struct timespec found;
    clock_gettime(CLOCK_REALTIME, &found);
    now->tv_sec = found.tv_sec;
    now->tv_usec = found.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *now) {
    struct timeval found;
    gettimeofday(&found, 0);
    if (now) *now = found.tv_sec;
    return found.tv_sec;
}
"""


class Clocks:
    """The clocks of processes, by name, in ``folder``; at first they are right."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._library = folder / "clock.so"
        self.missing = self._build()
        """Reason why no clock can be moved; None if clocks can be moved."""

    def _build(self) -> str | None:
        library = str(self._library)
        command = ("cc", "-shared", "-fPIC", "-O1", "-x", "c", "-", "-o", library, "-ldl")
        return refusal(*command, input=_SOURCE)

    def command(self, name: str) -> tuple[str, ...]:
        """Returns the module and arguments to put before a process's own, to give it a clock."""
        if not self._file(name).exists():
            self.set(name, 0)
        return ("benchmarks.chaos.clock", str(self._library), str(self._file(name)))

    def set(self, name: str, seconds: int) -> None:
        """Sets a clock this many seconds ahead, or behind if negative."""
        with os.fdopen(os.open(self._file(name), os.O_WRONLY | os.O_CREAT), "wb") as file:
            file.write(seconds.to_bytes(8, sys.byteorder, signed=True))  # a C long, in its place

    def _file(self, name: str) -> Path:
        return self._folder / f"{name}.clock"


def main(library: str, file: str, module: str, *arguments: str) -> None:
    """Replaces this process by that of ``module``."""
    os.environ |= {"LD_PRELOAD": library, "CHAOS_CLOCK": file}
    os.execv(sys.executable, [sys.executable, "-m", module, *arguments])


if __name__ == "__main__":
    main(*sys.argv[1:])
