"""What is written for an engine, and what is refused before anything is."""

import os
import random
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from common.errors import InputError
from common.exit_codes import EXIT_CODES, UNREACHABLE
from deploy.hub_port import PORTS, free_port
from deploy.slurm import FINAL_HERE
from tests.deploy.launched import launch
from tests.paths import ROOT
from tests.patience import PATIENCE, wait_until


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
    assert "\nactors=3\n" in actors


def test_a_run_is_submitted_to_slurm_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second job of a hub would move the run's address, fail, and cancel the actors."""
    queue, submitted = tmp_path / "queue", tmp_path / "submitted"
    for name, text in (
        ("squeue", f"cat {queue}"),
        ("sbatch", f"echo $@ >>{submitted}; echo job 7"),
    ):
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / name).chmod(0o700)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    own = ("slurm", "--submit", "--run=r", f"--runs={tmp_path}", "--no-tls")
    queue.write_text("")
    launch(monkeypatch, *own)
    assert capsys.readouterr().out.startswith("job 7. Follow it:")
    queue.write_text("7 all r PENDING\n")
    with pytest.raises(
        InputError, match=r"^a job called r is there already: end it .*scancel --me"
    ):
        launch(monkeypatch, *own)
    queue.unlink()
    with pytest.raises(InputError, match=r"^squeue failed: cat: .*queue"):
        launch(monkeypatch, *own)
    assert submitted.read_text() == f"{tmp_path}/r/slurm/learner.sh\n"


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
        ((), ("--learning.n-step=0",), "learning.n-step is 0"),
        ((), ("--local",), "--local is set by the launcher"),
        ((), ("--listen=tcp/0.0.0.0:1",), "--listen is set by the launcher"),
        ((), ("--actors=3",), "--actors is set by the launcher"),
        ((), ("--run=q",), "write them before `--`"),
        ((), ("--cuda-graphs",), "--cuda-graphs needs a GPU: write --gpus 1 before `--`"),
        (("--actors=0",), (), "--actors"),
        (("--actors=5000",), (), "--actors is 5000: choose at most 4096"),
        (("--max-actors=5000",), (), "--max-actors is 5000: choose at most 4096"),
        (("--evaluators=5000",), (), "--evaluators is 5000: choose at most 4096"),
        (("--cpus=2000",), (), "--cpus is 2000: choose at most 1024"),
        (("--partition=a\n#SBATCH --wrap=x",), (), "--partition"),
        (("--time=1;date",), (), "--time"),
        (("--time=xx",), (), "--time 'xx' is not a time of Slurm's: write minutes, or HOURS:"),
        (("--time=1:2:3:4",), (), "--time '1:2:3:4' is not a time"),
        (("--time=2-",), (), "--time '2-' is not a time"),
        (("--time=",), (), "--time '' is not a time"),
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


def test_a_flag_of_the_run_on_the_launchers_side_is_told_its_place(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"no flag --game.* Flags of the run itself come after"):
        launch(monkeypatch, "slurm", f"--runs={tmp_path}", "--game=pong")


@pytest.mark.parametrize("time", ["90", "90:00", "1:30:00", "2-12", "2-12:30", "2-12:30:00"])
def test_the_times_of_slurm_are_those_of_its_manual(
    time: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    launch(monkeypatch, "slurm", "--run=p", f"--runs={tmp_path}", "--no-tls", f"--time={time}")
    assert f"\n#SBATCH --time={time}\n" in (tmp_path / "p/slurm/actors.sh").read_text()


@pytest.mark.parametrize(
    ("engine", "edited", "own"),
    [
        ("slurm", "learner.sh", "actors.sh"),
        ("kubernetes", "base/learner.yaml", "kustomization.yaml"),
        ("compose", "compose.yaml", "compose.override.yaml"),
    ],
)
def test_edits_of_the_files_of_an_engine_are_kept(
    engine: str,
    edited: str,
    own: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    flags = (engine, "--run=p", f"--runs={tmp_path}", "--no-tls")
    place = tmp_path / "p" / engine
    launch(monkeypatch, *flags)
    first = capsys.readouterr().out
    written = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    launch(monkeypatch, *flags)
    assert capsys.readouterr().out == first
    assert {path: path.read_bytes() for path in place.rglob("*") if path.is_file()} == written
    with (place / edited).open("a") as file:
        file.write("# by hand\n")
    launch(monkeypatch, *flags, "--actors=7")
    told, _, rest = capsys.readouterr().out.partition("\n")
    assert told.startswith(f"What was different in {place} before is kept as FILE.bak: ")
    assert {*told.rpartition(": ")[2].removesuffix(".").split(", ")} == {edited, own}
    assert rest == first
    assert b"# by hand" not in (place / edited).read_bytes()
    assert (place / f"{edited}.bak").read_bytes() == written[place / edited] + b"# by hand\n"
    assert (place / f"{own}.bak").read_bytes() == written[place / own]


class Job:
    """The script of an engine's job, with programs in the place of others."""

    def __init__(
        self,
        folder: Path,
        python: str,
        *,
        module: str = "actors",
        jobs: str = "",
        others: str = "",
        queue: str = "",
        number: int = 7,
    ) -> None:
        self._number = str(number)
        self.folder, self.said, self.address = folder, folder / "said", folder / "address"
        (folder / "slurm").mkdir()
        port = f'[ "$2" = deploy.hub_port ] && exec {sys.executable} "$@"'
        self._program("python", f'{port}\necho "$@" >>{self.said}\n{python}')
        self._program("sleep", "exec /bin/sleep 0.1")  # not 5 s between looks
        self._program("squeue", queue)
        for name in ("scontrol", "scancel", "sbatch"):
            self._program(name, f'echo {name} "$@" >>{self.said}')
        self._script = folder / "job.sh"
        body = (ROOT / "deploy/slurm/job.sh").read_text()
        self._script.write_text(
            f"run={folder}\npython={folder}/python\nscheme=tcp\nmodule={module} hub=replay\n"
            "begun=begun kept=kept\nactors=1\nbegin=(--begin)\nresume=(--resume)\n"
            f"others=({others})\njobs=({jobs})\nfinal=({shlex.join(FINAL_HERE)})\n{body}"
        )
        self.address.write_text("tcp/old:1\n")

    def _program(self, name: str, text: str) -> None:
        path = self.folder / name
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o700)

    @contextmanager
    def runs(self) -> Iterator[subprocess.Popen[bytes]]:
        environment = {"PATH": f"{self.folder}:/usr/bin:/bin"}
        environment |= {"SLURM_ARRAY_TASK_ID": "1", "SLURM_JOB_ID": self._number}
        job = subprocess.Popen(["bash", self._script], env=environment, start_new_session=True)
        try:
            yield job
        finally:
            with suppress(ProcessLookupError):
                os.killpg(job.pid, signal.SIGKILL)
            job.wait()

    def ends(self) -> int:
        with self.runs() as job:
            return job.wait(PATIENCE)

    def lines(self) -> list[str]:
        return self.said.read_text().splitlines()


def test_an_actor_follows_the_learner_to_another_node(tmp_path: Path) -> None:
    """A program in the actor's place waits for its end, as that does for a learner that is gone."""
    waits = "trap 'exit 0' TERM\nwhile :; do sleep 0.1; done"
    script = Job(tmp_path, f"[ $4 = tcp/new:1 ] && exit 0\n{waits}")
    with script.runs() as job:
        wait_until(script.said.exists, "the actor is there")
        script.address.write_text("tcp/new:1\n")
        assert job.wait(PATIENCE) == 0
    assert [line.split()[3] for line in script.lines()] == ["tcp/old:1", "tcp/new:1"]


@pytest.mark.parametrize(
    ("end", "again"),
    [
        ("kill -9 $$", True),
        *((f"exit {code.number}", code.again) for code in EXIT_CODES if code.number != UNREACHABLE),
        (f"exit {UNREACHABLE}", False),  # it has waited, and leaves its core to others
    ],
)
def test_an_actor_that_ends_starts_again_unless_that_is_in_vain(
    end: str, again: bool, tmp_path: Path
) -> None:
    script = Job(tmp_path, f"[ $(wc -l <{tmp_path}/said) -lt 2 ] || exit 0\n{end}")
    status = script.ends()
    assert len(script.lines()) == 1 + again
    assert status == (0 if again else int(end.split()[1]))


@pytest.mark.parametrize("module", ["learner", "replay"])
@pytest.mark.parametrize(
    ("end", "goes_on"),
    [("touch kept; kill -9 $$", True), ("kill -9 $$", False), ("exit 3", False), ("exit 0", False)],
)
def test_a_job_that_was_killed_is_queued_again_if_it_got_on(
    end: str, goes_on: bool, module: str, tmp_path: Path
) -> None:
    script = Job(tmp_path, f"cd {tmp_path}; sleep 1; {end}", module=module, jobs="r-actors r")
    script.ends()
    _, *then = script.lines()
    assert script.address.exists() == goes_on
    ended = [f"scancel --quiet --me --name {job}" for job in ("r-actors", "r")]
    assert then == (["scontrol requeue 7"] if goes_on else ended)


@pytest.mark.parametrize(
    ("queue", "submitted"),
    [
        ("", True),
        ("echo 8", False),  # it is there
        ("[ -e asked ] || { touch asked; exit 1; }", True),  # the second answer says that it is not
        ("exit 1", False),  # nobody knows, and a second learner would end the run
    ],
)
def test_a_hub_submits_those_that_are_not_in_the_queue(
    queue: str, submitted: bool, tmp_path: Path
) -> None:
    script = Job(
        tmp_path,
        "exit 0",
        module="replay",
        queue=f"cd {tmp_path}; {queue}",
        others="learner actors",
        jobs="r-learner r-actors",
    )
    script.ends()
    told = [line for line in script.lines() if line.startswith("sbatch")]
    wanted = [f"sbatch {tmp_path}/slurm/{part}.sh" for part in ("learner", "actors")]
    assert told == (wanted if submitted else [])


def test_a_hub_whose_port_is_taken_listens_at_another_one(tmp_path: Path) -> None:
    number = PORTS.index(free_port("0.0.0.0", random.randrange(len(PORTS))))
    script = Job(tmp_path, f"cd {tmp_path}; cp address told", module="replay", number=number)
    with socket.create_server(("0.0.0.0", PORTS[number])):
        assert script.ends() == 0
    port = (tmp_path / "told").read_text().strip().rpartition(":")[2]
    assert int(port) in set(PORTS) - {PORTS[number]}
    assert f"-m replay --listen tcp/0.0.0.0:{port} --begin" in script.lines()


def test_what_joins_a_replay_goes_on_with_its_part_of_the_run(tmp_path: Path) -> None:
    """A learner that moves with its replay has begun by then."""
    waits = "trap 'exit 0' TERM\nwhile :; do sleep 0.1; done"
    first = f"[ $4 = tcp/new:1 ] && exit 0\ntouch {tmp_path}/begun\n{waits}"
    script = Job(tmp_path, first, module="learner")
    with script.runs() as job:
        wait_until((tmp_path / "begun").exists, "the learner is there")
        script.address.write_text("tcp/new:1\n")
        assert job.wait(PATIENCE) == 0
    told = ["--connect tcp/old:1 --begin", "--connect tcp/new:1 --resume"]
    assert script.lines() == [f"-m learner {each}" for each in told]


def test_slurm_gives_a_replay_a_job_that_submits_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = ("--replay", "--run=p", f"--runs={tmp_path}", "--replay-cpus=3", "--replay-memory=5")
    launch(monkeypatch, "slurm", *own, "--", "--env", "ale", "--actor-quota=77")
    place = tmp_path / "p" / "slurm"
    assert f"sbatch {place}/replay.sh" in capsys.readouterr().out
    heads = {part: (place / f"{part}.sh").read_text() for part in ("replay", "learner", "actors")}
    for part, others, jobs in (
        ("replay", "learner actors", "p-learner p-actors"),
        ("learner", "actors replay", "p-actors p"),
        ("actors", "learner replay", "p-learner p"),
    ):
        assert f"\nmodule={part} hub=replay " in heads[part]
        assert f"\nothers=({others})\njobs=({jobs})\n" in heads[part]
    assert "\n#SBATCH --job-name=p\n" in heads["replay"]
    assert "\n#SBATCH --cpus-per-task=3\n#SBATCH --mem=5G\n" in heads["replay"]
    where = f"--run p --runs {tmp_path}"
    assert f"\nbegin=({where} --restart 3 --preset fast --actor-quota 77)\n" in heads["replay"]
    learner = f"{where} --threads 4 --restart 3 --env ale --actor-quota=77 --patience inf"
    learner += " --actor-quota 10000"
    assert f"\nbegin=({learner})\nresume=({learner} --resume)\n" in heads["learner"]


def test_each_actor_of_slurm_has_a_certificate_of_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    own = ("slurm", "--run=p", f"--runs={tmp_path}")
    launch(monkeypatch, *own, "--actors=2")
    folder = tmp_path / "p" / "certificates"
    names = ["actor-1", "actor-2", "evaluator-3"]
    assert (folder / "actors.txt").read_text().split() == names
    keys = [(folder / f"actor.{name}-key.pem").read_bytes() for name in names]
    # Those that are there stay, and one that was shut out stays out.
    (folder / "actors.txt").write_text("actor-1\nevaluator-3\n")
    launch(monkeypatch, *own, "--actors=3")
    assert (folder / "actors.txt").read_text().split() == [*names[::2], "actor-3", "evaluator-4"]
    assert [(folder / f"actor.{name}-key.pem").read_bytes() for name in names] == keys
