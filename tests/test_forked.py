"""Programs that are forked where a test would start them."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest


@pytest.mark.usefixtures("forks")
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("executable", "/bin/true"),
        ("close_fds", False),
        ("pass_fds", (0,)),
        ("shell", True),
        ("restore_signals", False),
        ("group", os.getgid()),
        ("extra_groups", []),
        ("user", os.getuid()),
        ("umask", 0o77),
        ("process_group", os.getpgrp()),
    ],
)
def test_what_a_fork_has_not_is_refused(name: str, value: Any) -> None:
    known_as = {"group": "gid", "extra_groups": "gids", "user": "uid"}.get(name, name)
    with pytest.raises(NotImplementedError, match=f"has no {known_as}$"):
        subprocess.Popen([sys.executable, "-m", "this"], **{name: value})


@pytest.mark.usefixtures("forks")
def test_what_a_fork_has_is_given(tmp_path: Path) -> None:
    (tmp_path / "told.py").write_text(
        "import os, sys\n"
        "leads = os.getsid(0) == os.getpid()\n"
        "print(os.getcwd(), os.environ['TOLD'], sys.argv[1], input(), leads, os.nice(0))"
    )
    done = subprocess.run(
        [sys.executable, "-m", "told", "word"],
        cwd=tmp_path,
        env={"TOLD": "hint", "PYTHONPATH": str(tmp_path)},
        input="line",
        capture_output=True,
        text=True,
        start_new_session=True,
        preexec_fn=partial(os.nice, 1),
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{tmp_path} hint word line True {os.nice(0) + 1}\n"
