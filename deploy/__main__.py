"""`python -m deploy ENGINE … -- FLAGS`: launches a run on an engine that exists already."""

if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.abspath(f"{__file__}/../.."):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

    from common.process.lifeline import leave_at_interrupt

    leave_at_interrupt()

import sys
from importlib import import_module

from common.command_line.parser import parse
from common.errors import InputError
from common.process.extras import extra_for
from common.process.program_end import exit_on_input_error
from deploy.description import LaunchOptions, describe


def main() -> None:
    """Writes the files that the engine needs, and prints what to do with them."""
    given = sys.argv[1:]
    at = given.index("--") if "--" in given else len(given)
    try:
        options = parse(LaunchOptions, "deploy", given[:at])
    except InputError as error:
        if at < len(given) or not str(error).startswith("there is no flag"):
            raise
        raise InputError(f"{error} Flags of the run itself come after `--`.") from None
    run = describe(options, given[at + 1 :])
    with extra_for("launch ray", "ray"):  # no other engine needs an extra package
        name = "ray_cluster" if options.engine == "ray" else options.engine
        engine = import_module(f"deploy.{name}")
    print(engine.launch(run))


if __name__ == "__main__":
    exit_on_input_error(main)
