"""What is written for an engine, and what is refused before anything is."""

import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from common.errors import InputError
from deploy.__main__ import main
from tests.paths import ROOT
from tests.patience import wait_until


def launch(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["ale-robot launch", *arguments])
    main()


def test_the_jobs_of_slurm_hold_the_description(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = ("--run=p", f"--runs={tmp_path}")
    engine = ("--actors=3", "--evaluators=2", "--cpus=5", "--gpus=1", "--time=1-02:00:00")
    flags = ("--env", "ale", "--initial", "ale_pong", "--force")
    launch(monkeypatch, "slurm", *runs, *engine, "--partition=night", "--", *flags)
    place = tmp_path / "p" / "slurm"
    assert f"sbatch {place}/learner.sh" in capsys.readouterr().out
    learner, actors = ((place / f"{part}.sh").read_text() for part in ("learner", "actors"))
    for script in (learner, actors):
        subprocess.run(["bash", "-n"], input=script.encode(), check=True)
        for line in ("--requeue", "--time=1-02:00:00", "--partition=night"):
            assert f"\n#SBATCH {line}\n" in script
    assert "\n#SBATCH --gpus=1\n" in learner
    where = f"--run p --runs {tmp_path}"
    assert (
        f"\nbegin=({where} --threads 5 --restart 3 --env ale --initial ale_pong --force)\n"
        in learner
    )
    # A network to begin with has no place in a run that goes on.
    assert f"\nresume=({where} --threads 5 --restart 3 --env ale --resume --force)\n" in learner
    assert "\n#SBATCH --array=1-5\n" in actors
    assert "\nactors=(3)\n" in actors


def test_no_flag_is_run_as_shell_text(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    wicked = tmp_path / "a 'b' $(touch pwned) `touch pwned`\n#SBATCH --wrap=x .safetensors"
    shutil.copy(ROOT / "policies" / "ale_pong.safetensors", wicked)
    flags = ("--env", "ale", "--initial", str(wicked))
    launch(monkeypatch, "slurm", "--run=p", f"--runs={tmp_path}", "--", *flags)
    head, _, _ = (tmp_path / "p/slurm/learner.sh").read_text().partition("set -u")
    assert "\n#SBATCH --wrap" not in head.partition("\nrun=")[0]  # where sbatch stops to look
    shown = subprocess.run(
        ["bash", "-c", head + 'printf "%s\\0" "${begin[@]}"'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert tuple(shown.stdout.rstrip("\0").split("\0")[-4:]) == flags
    assert not (tmp_path / "pwned").exists()


@pytest.mark.parametrize(
    ("own", "flags", "told"),
    [
        ((), ("--learning.n-stepp=3",), "there is no flag --learning.n-stepp"),
        ((), ("--learning.n-step=0",), "learning.n_step is 0"),
        ((), ("--local",), "--local is the launcher's"),
        ((), ("--listen=tcp/0.0.0.0:1",), "--listen is the launcher's"),
        ((), ("--run=q",), "write them before `--`"),
        (("--actors=0",), (), "--actors"),
        (("--partition=a\n#SBATCH --wrap=x",), (), "--partition"),
        (("--time=1;date",), (), "--time"),
        (("--run=../q",), (), "cannot be used"),
    ],
)
def test_what_cannot_run_is_refused_before_it_waits_in_a_queue(
    own: tuple[str, ...],
    flags: tuple[str, ...],
    told: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    runs = () if own[:1] == ("--run=../q",) else ("--run=p",)
    with pytest.raises(InputError, match=told):
        launch(monkeypatch, "slurm", *runs, f"--runs={tmp_path}", *own, "--", *flags)
    assert not list(tmp_path.iterdir())


def test_an_actor_follows_the_learner_to_another_node(tmp_path: Path) -> None:
    """The job's script with a program in the actor's place that waits for its end, as an actor
    does for a learner that is gone."""
    said, address = tmp_path / "said", tmp_path / "address"
    program = tmp_path / "python"
    program.write_text(
        f"#!/bin/sh\necho $4 >>{said}\n"
        f"[ $4 = tcp/new:1 ] && exit 0\ntrap 'exit 0' TERM\nwhile :; do sleep 0.1; done\n"
    )
    program.chmod(0o700)
    (tmp_path / "sleep").write_text("#!/bin/sh\nexec /bin/sleep 0.1\n")  # not 5 s between looks
    (tmp_path / "sleep").chmod(0o700)
    head = f"run={tmp_path}\npython={program}\nscheme=tcp\nactors=(1)\nflags=()\n"
    script = tmp_path / "actors.sh"
    script.write_text(head + (ROOT / "deploy/slurm/actors.sh").read_text())
    address.write_text("tcp/old:1\n")
    environment = {"SLURM_ARRAY_TASK_ID": "1", "PATH": f"{tmp_path}:/usr/bin:/bin"}
    job = subprocess.Popen(["bash", script], env=environment, start_new_session=True)
    try:
        wait_until(said.exists, "the actor is there")
        address.write_text("tcp/new:1\n")
        wait_until(lambda: job.poll() is not None, "the job is over")
    finally:
        with suppress(ProcessLookupError):
            os.killpg(job.pid, signal.SIGKILL)
        job.wait()
    assert job.returncode == 0
    assert said.read_text().split() == ["tcp/old:1", "tcp/new:1"]
