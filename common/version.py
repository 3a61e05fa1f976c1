"""The version of this software; processes report it to each other."""

from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("ale-robot")
except PackageNotFoundError:
    VERSION = "unknown"
