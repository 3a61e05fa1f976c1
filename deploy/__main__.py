"""`python -m deploy ENGINE … -- FLAGS`: launches a run on an engine that is there already."""

if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

import sys

from common.errors import exit_on_input_error
from common.process.command_line import parse
from common.process.extras import extra_for
from deploy import compose, kubernetes, slurm
from deploy.description import LaunchOptions, RunDescription, describe


def _ray(run: RunDescription) -> str:
    """As the others; what talks to Ray is loaded only where it is wanted."""
    with extra_for("launch ray", "ray"):
        from deploy import ray_cluster
    return ray_cluster.launch(run)


_ENGINES = {
    "slurm": slurm.launch,
    "kubernetes": kubernetes.launch,
    "compose": compose.launch,
    "ray": _ray,
}


def main() -> None:
    """Writes what the engine needs, and says what to do with it."""
    given = sys.argv[1:]
    at = given.index("--") if "--" in given else len(given)
    options = parse(LaunchOptions, "deploy", given[:at])
    print(_ENGINES[options.engine](describe(options, given[at + 1 :])))


if __name__ == "__main__":
    exit_on_input_error(main)
