"""A room in which NAO sits, for each module that wants one."""

from collections.abc import Iterator

import pytest

from actors.robots.nao.robot import Nao


@pytest.fixture(scope="module")
def room() -> Iterator[Nao]:
    room = Nao()
    yield room
    room.close()
