"""A Slurm cluster of three nodes on this machine, as the present user, in a folder."""

import os
import secrets
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from benchmarks.child import free_port
from tests.patience import wait_until

PROGRAMS = {name: shutil.which(name, path="/usr/sbin:/usr/bin") for name in
            ("munged", "slurmctld", "slurmd", "sbatch")}  # fmt: skip
MISSING = [name for name, found in PROGRAMS.items() if found is None]
NODES = ("n1", "n2", "n3")


class Cluster:
    """Commands of a cluster that is up."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder = folder
        self.environment = environment

    def __call__(self, *command: str) -> str:
        """Returns what ``command`` prints."""
        done = subprocess.run(
            command, env=self.environment, cwd=self.folder, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
        return done.stdout

    def states(self) -> dict[str, str]:
        """State of each job in the queue, by its name and, of an array, the task's number."""
        lines = self("squeue", "--array", "--noheader", "--format=%j %K %T").splitlines()
        return {name: state for name, _, state in (each.rpartition(" ") for each in lines)}

    def job_id(self, name: str) -> str:
        return self("squeue", "--noheader", "--format=%i", "--name", name).strip()


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """Starts the daemons, and ends them and all jobs."""
    folder.mkdir(mode=0o700)
    key, munge = folder / "key", folder / "munge.socket"
    key.write_bytes(secrets.token_bytes(128))
    key.chmod(0o600)
    host, ctld = socket.gethostname().split(".")[0], free_port()
    nodes = [
        f"NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={free_port()} CPUs=4 "
        "RealMemory=64000"
        for node in NODES
    ]
    settings = [
        "ClusterName=test",
        f"SlurmctldHost={host}(127.0.0.1)",
        f"SlurmctldPort={ctld}",
        f"SlurmUser={os.environ.get('USER', 'root')}",
        f"SlurmdUser={os.environ.get('USER', 'root')}",
        f"AuthInfo=socket={munge},cred_expire=5",  # a requeued job waits as long
        f"StateSaveLocation={folder}/state",
        f"SlurmdSpoolDir={folder}/spool-%n",
        f"SlurmctldPidFile={folder}/slurmctld.pid",
        f"SlurmdPidFile={folder}/%n.pid",
        "ProctrackType=proctrack/linuxproc",
        "TaskPlugin=task/none",
        "JobAcctGatherType=jobacct_gather/none",
        "SelectType=select/cons_tres",
        "SelectTypeParameters=CR_Core_Memory",
        "SlurmdParameters=config_overrides",
        "MpiDefault=none",
        "KillWait=300",
        *nodes,
        "PartitionName=all Nodes=ALL Default=YES State=UP LLN=YES",  # the least loaded node first,
    ]
    (folder / "slurm.conf").write_text("\n".join(settings) + "\n")
    (folder / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")
    (folder / "state").mkdir()
    files = [
        f"--{name}={folder}/munge.{name}"
        for name in ("socket", "pid-file", "log-file", "seed-file")
    ]
    environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}
    with ExitStack() as stack:

        def start(name: str, program: str, *arguments: str) -> None:
            log = stack.enter_context((folder / f"{name}.log").open("wb"))
            command = [str(PROGRAMS[program]), *arguments]
            process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
            stack.callback(process.wait)
            stack.callback(process.terminate)

        start("munged", "munged", "-F", "--force", f"--key-file={key}", *files)
        wait_until(munge.exists, "munged is there")
        start("slurmctld", "slurmctld", "-D")
        for node in NODES:
            start(node, "slurmd", "-D", "-N", node)
        made = Cluster(folder, environment)
        idle = ["sinfo", "--noheader", "--states=idle", "--format=%D"]

        def up() -> bool:
            found = subprocess.run(idle, env=environment, capture_output=True, text=True)
            return found.stdout.strip() == str(len(NODES))

        wait_until(up, f"the nodes of {folder} are idle")
        try:
            yield made
        finally:
            made("scancel", "--me")
            wait_until(lambda: not made.states(), "no job is left")
