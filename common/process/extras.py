"""Packages that only some flags need (extras of `pyproject.toml`)."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from common.errors import InputError

PACKAGES = {
    "hub": ("huggingface_hub",),
    "mlflow": ("mlflow",),
    "ops": ("prometheus_client", "starlette", "uvicorn"),
    "record": ("pyarrow",),
    "trackio": ("trackio",),
    "viz": ("rerun",),
    "wandb": ("wandb",),
    "web": ("starlette", "uvicorn"),
}
"""The packages that are imported for each extra."""


def check_extra(flag: str, extra: str) -> None:
    """Checks that the packages of ``extra`` are installed, before anything is loaded or built.
    Raises InputError as `extra_for` does, which also notices what these packages lack."""
    with extra_for(flag, extra):
        for package in PACKAGES[extra]:
            if find_spec(package) is None:
                raise ModuleNotFoundError(name=package)


@contextmanager
def extra_for(flag: str, extra: str) -> Iterator[None]:
    """Raises InputError, with the command that installs ``extra``, if an import within the block
    does not find its package. Without an ``extra``, the package is to be installed as such."""
    try:
        yield
    except ModuleNotFoundError as error:
        how = f"pip install 'ale-robot[{extra}]'" if extra else "install it"
        raise InputError(
            f"{flag} needs the package {error.name}, which is not installed: {how}."
        ) from None
