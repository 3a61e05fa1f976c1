"""Ports of hubs that a launcher chooses: the one of a number, or the next that is free."""

import errno

import pytest

from common.errors import InputError
from deploy.hub_port import PORTS, free_port


def _take(taken: set[int], monkeypatch: pytest.MonkeyPatch) -> None:
    def check_free(host: str, port: int) -> None:
        if port in taken:
            raise OSError(errno.EADDRINUSE, "Address already in use")

    monkeypatch.setattr("deploy.hub_port.check_free", check_free)


@pytest.mark.parametrize(
    ("number", "port"),
    [(0, 20_000), (2, 20_003), (41_007, 21_007), (9_998, 29_998), (9_999, 20_000)],
)
def test_a_taken_port_is_passed_over(
    number: int, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    _take({20_002, 29_999}, monkeypatch)
    assert free_port("0.0.0.0", number) == port


def test_a_machine_without_a_free_port_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    _take(set(PORTS), monkeypatch)
    with pytest.raises(InputError, match=r"from 20000 to 29999 is free at 10\.0\.0\.1"):
        free_port("10.0.0.1", 5)
