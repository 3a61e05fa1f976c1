"""The version of this software; processes report it to each other."""

from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("ale-robot")
except PackageNotFoundError:
    VERSION = "unknown"


def other_version(error: Exception) -> str:
    """Returns a clause that says that a run is of another version, as ``error`` shows."""
    return (
        f"the run there is of another version than this program, {VERSION} ({error}): "
        "use the same version on both sides"
    )
