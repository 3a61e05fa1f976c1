"""The version of this software, which processes tell each other."""

from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("ale-robot")
except PackageNotFoundError:
    VERSION = "unknown"
