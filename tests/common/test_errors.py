"""How a program ends: by its own status, or with one line for the user."""

import pytest

from common.errors import InputError, MessageError, exit_on_input_error


@pytest.mark.parametrize(("returned", "status"), [(None, None), (0, 0), (3, 3)])
def test_a_program_exits_with_its_own_status(returned: int | None, status: int | None) -> None:
    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(lambda: returned)
    assert caught.value.code == status


def test_an_input_error_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    def main() -> int:
        raise InputError("the port is taken: choose another.")

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == 2
    assert capsys.readouterr() == ("", "error: the port is taken: choose another.\n")


def test_ctrl_c_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    def main() -> int:
        raise KeyboardInterrupt

    with pytest.raises(SystemExit) as caught:
        exit_on_input_error(main)
    assert caught.value.code == 130
    assert capsys.readouterr() == ("", "")


def test_other_errors_are_bugs_and_keep_their_traceback() -> None:
    def main() -> int:
        raise MessageError("not caught")

    with pytest.raises(MessageError, match="not caught"):
        exit_on_input_error(main)
